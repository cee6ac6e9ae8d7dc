/* Cortex-M33 start-up: vectors, memory, and semihosting for a test under QEMU's mps2-an505. */
#include <stdint.h>
#include <stdlib.h>

extern uint32_t image_data[], data_begin[], data_end[], bss_begin[], bss_end[], stack_top[];
int main(void);
void initialise_monitor_handles(void); /* of the C library, by rdimon.specs */

/* The C library calls these before and after main; C needs nothing there. */
void _init(void);
void _fini(void);

void _init(void)
{
}

void _fini(void)
{
}

static void reset(void)
{
    const uint32_t *from = image_data;
    for (uint32_t *to = data_begin; to < data_end; to++) {
        *to = *from;
        from++;
    }
    for (uint32_t *to = bss_begin; to < bss_end; to++) {
        *to = 0;
    }
#ifdef PW_SEMIHOSTING
    initialise_monitor_handles();
#endif
    exit(main());
}

static void fault(void)
{
#ifdef PW_SEMIHOSTING
    _Exit(99); /* the test has failed; the fault's registers are for a debugger */
#else
    for (;;) {
    }
#endif
}

typedef void (*vector)(void);

struct vectors {
    const uint32_t *stack;
    vector handlers[15];
};

extern const struct vectors vectors;
__attribute__((section(".vectors"), used)) const struct vectors vectors = {
    stack_top, {reset, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault}};
