/* Stands in for the chip when the program's C is compiled for another machine: time is set by the test, and what would be
   rasterised is noted down. */
#include "../../../firmware/xmos/processor/hardware.h"
#include "../../../firmware/xmos/processor/processor.h"

#include <string.h>

uint32_t play_timer, play_clock, play_inbox, play_ready;
uint32_t handle_timer, handle_clock, handle_inbox, handle_ready;
uint32_t receive_play, receive_play_ready, receive_handle, receive_handle_ready;
uint32_t config_end, answer_end, started_from, started_to;
uint32_t sync_port = 1, supply_port = 2, temperature_port = 3, state_lock;
uint32_t unique_id[2], damaged_received, heard, first_time, first_stamp;
const uint8_t firmware_version[4] = { 1, 2, 3, 0 };

uint32_t test_time, test_temperature, test_supply = 1, test_stamp;
uint32_t test_slice[SLICE_WORDS];
uint32_t test_row; /* of widths, or 256 if pulses are left as they are */
uint32_t test_renders;

uint32_t timer_now(uint32_t timer) { return timer == 0u ? test_time : 0u; }
void lock_take(uint32_t lock) { (void)lock; }
void lock_give(uint32_t lock) { (void)lock; }

static uint32_t crc_bits(uint32_t crc, uint32_t data, uint32_t bits)
{
    for (uint32_t bit = 0; bit < bits; bit++) {
        const uint32_t low = crc & 1u;
        crc = crc >> 1 | (data >> bit & 1u) << 31;
        crc ^= low != 0u ? CRC_POLYNOMIAL : 0u;
    }
    return crc;
}

uint32_t crc_word(uint32_t crc, uint32_t word) { return crc_bits(crc, word, 32); }
uint32_t crc_byte(uint32_t crc, uint32_t byte) { return crc_bits(crc, byte, 8); }
uint32_t port_peek(uint32_t port) { return port == supply_port ? test_supply : test_temperature; }
uint32_t port_take(uint32_t port) { return port_peek(port); }
uint32_t port_stamp(uint32_t port) { (void)port; return test_stamp; }
void port_compare(uint32_t port, uint32_t value) { (void)port; (void)value; }
void events_on(uint32_t resource) { (void)resource; }
void events_off(uint32_t resource) { (void)resource; }
void signal_take(uint32_t end) { (void)end; }
void signal_send(uint32_t end) { (void)end; }
void end_aim(uint32_t end, uint32_t destination) { (void)end; (void)destination; }
void end_token(uint32_t end, uint32_t token) { (void)end; (void)token; }
void end_control(uint32_t end, uint32_t token) { (void)end; (void)token; }
void end_word(uint32_t end, uint32_t word) { (void)end; (void)word; }
uint32_t end_take_control(uint32_t end) { (void)end; return 3; }
uint32_t end_take_word(uint32_t end) { (void)end; return 0; }
uint32_t byte_reversed(uint32_t word) { return word; }
void play_events(void) {}
uint32_t play_wait(uint32_t time) { (void)time; return 0; }
void handle_events(void) {}
uint32_t handle_wait(uint32_t time) { (void)time; return 0; }
void slice_copy(uint32_t *to, const uint32_t *from) { memcpy(to, from, sizeof(uint32_t) * SLICE_WORDS); }

uint32_t raster_begin(const uint32_t *slice, const uint8_t *row, uint32_t *edges, uint32_t *table)
{
    (void)edges;
    (void)table;
    memcpy(test_slice, slice, sizeof test_slice);
    test_row = row == 0 ? 256u : (uint32_t)(row - widths) / WIDTHS;
    test_renders++;
    return 0;
}

void raster_end(uint32_t *edges, uint32_t *table, uint32_t levels) { (void)edges; (void)table; (void)levels; }

bool test_is_silent(void) { return next_table == silent_table; }
void test_number(uint32_t node) { number = node; }
