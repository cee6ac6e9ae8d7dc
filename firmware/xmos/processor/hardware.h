/* What the C of this program needs of the chip, each a single instruction. On another machine, where tests compile the
   same C, `hardware.c` of the tests stands in for it. */
#ifndef PW_HARDWARE_H
#define PW_HARDWARE_H

#include <stdint.h>

#define CRC_POLYNOMIAL 0xEDB88320u

#ifdef __XS1B__

/* The time of a timer, in 10 ns. */
static inline uint32_t timer_now(uint32_t timer)
{
    uint32_t time;
    __asm__ volatile("in %0, res[%1]" : "=r"(time) : "r"(timer) : "memory");
    return time;
}

/* Waits until nobody holds the lock, and holds it. */
static inline void lock_take(uint32_t lock)
{
    uint32_t word;
    __asm__ volatile("in %0, res[%1]" : "=r"(word) : "r"(lock) : "memory");
}

static inline void lock_give(uint32_t lock)
{
    __asm__ volatile("out res[%0], %0" : : "r"(lock) : "memory");
}

/* One step of a CRC-32: 32 more bits follow those before. */
static inline uint32_t crc_word(uint32_t crc, uint32_t word)
{
    __asm__("crc32 %0, %1, %2" : "+r"(crc) : "r"(word), "r"(CRC_POLYNOMIAL));
    return crc;
}

/* 8 more bits. */
static inline uint32_t crc_byte(uint32_t crc, uint32_t byte)
{
    uint32_t rest;
    __asm__("crc8 %1, %0, %2, %3" : "=r"(rest), "+r"(crc) : "r"(byte), "r"(CRC_POLYNOMIAL));
    return crc;
}

/* What the input pins of a port are now. */
static inline uint32_t port_peek(uint32_t port)
{
    uint32_t value;
    __asm__ volatile("peek %0, res[%1]" : "=r"(value) : "r"(port));
    return value;
}

/* What the input pins were when the port's condition was met. */
static inline uint32_t port_take(uint32_t port)
{
    uint32_t value;
    __asm__ volatile("in %0, res[%1]" : "=r"(value) : "r"(port));
    return value;
}

/* The port's count when that was. */
static inline uint32_t port_stamp(uint32_t port)
{
    uint32_t stamp;
    __asm__ volatile("getts %0, res[%1]" : "=r"(stamp) : "r"(port));
    return stamp;
}

/* What the port's condition compares with. */
static inline void port_compare(uint32_t port, uint32_t value)
{
    __asm__ volatile("setd res[%0], %1" : : "r"(port), "r"(value));
}

static inline void events_on(uint32_t resource)
{
    __asm__ volatile("eeu res[%0]" : : "r"(resource));
}

static inline void events_off(uint32_t resource)
{
    __asm__ volatile("edu res[%0]" : : "r"(resource));
}

/* Takes an END, and sends one: threads wake each other so. */
static inline void signal_take(uint32_t end)
{
    __asm__ volatile("chkct res[%0], 1" : : "r"(end) : "memory");
}

static inline void signal_send(uint32_t end)
{
    __asm__ volatile("outct res[%0], 1" : : "r"(end) : "memory");
}

/* Of a channel end: where it sends to; a token, a control token, a word with its high byte first. */
static inline void end_aim(uint32_t end, uint32_t destination)
{
    __asm__ volatile("setd res[%0], %1" : : "r"(end), "r"(destination));
}

static inline void end_token(uint32_t end, uint32_t token)
{
    __asm__ volatile("outt res[%0], %1" : : "r"(end), "r"(token));
}

static inline void end_control(uint32_t end, uint32_t token)
{
    __asm__ volatile("outct res[%0], %1" : : "r"(end), "r"(token));
}

static inline void end_word(uint32_t end, uint32_t word)
{
    __asm__ volatile("out res[%0], %1" : : "r"(end), "r"(word));
}

static inline uint32_t end_take_control(uint32_t end)
{
    uint32_t token;
    __asm__ volatile("inct %0, res[%1]" : "=r"(token) : "r"(end));
    return token;
}

static inline uint32_t end_take_word(uint32_t end)
{
    uint32_t word;
    __asm__ volatile("in %0, res[%1]" : "=r"(word) : "r"(end));
    return word;
}

static inline uint32_t byte_reversed(uint32_t word)
{
    uint32_t reversed;
    __asm__("byterev %0, %1" : "=r"(reversed) : "r"(word));
    return reversed;
}

/* Nothing moves over this: what was written before is there for other threads. */
#define MEMORY_FENCE() __asm__ volatile("" : : : "memory")

#else

uint32_t timer_now(uint32_t timer);
void lock_take(uint32_t lock);
void lock_give(uint32_t lock);
uint32_t crc_word(uint32_t crc, uint32_t word);
uint32_t crc_byte(uint32_t crc, uint32_t byte);
uint32_t port_peek(uint32_t port);
uint32_t port_take(uint32_t port);
uint32_t port_stamp(uint32_t port);
void port_compare(uint32_t port, uint32_t value);
void events_on(uint32_t resource);
void events_off(uint32_t resource);
void signal_take(uint32_t end);
void signal_send(uint32_t end);
void end_aim(uint32_t end, uint32_t destination);
void end_token(uint32_t end, uint32_t token);
void end_control(uint32_t end, uint32_t token);
void end_word(uint32_t end, uint32_t word);
uint32_t end_take_control(uint32_t end);
uint32_t end_take_word(uint32_t end);
uint32_t byte_reversed(uint32_t word);
#define MEMORY_FENCE() ((void)0)

#endif

#endif
