/* Prints the memory that each part of the core takes on this processor. */
#include <stdio.h>

#include "dfu.h"
#include "processor.h"
#include "ser.h"
#include "usb.h"

#define SHOW(type, what) (void)printf("  %6u %s, %s\n", (unsigned)sizeof(struct type), #type, what)

int main(void)
{
    (void)printf("memory in bytes, with %u changes and %u records that wait:\n", (unsigned)PW_QUEUE_CHANGES,
                 (unsigned)PW_QUEUE_RECORDS);
    SHOW(pw_device, "the controller");
    SHOW(pw_usb, "its USB device");
    SHOW(pw_line, "each of its serial lines");
    SHOW(pw_dfu, "DFU mode");
    SHOW(pw_processor, "each processor of the chain");
    return 0;
}
