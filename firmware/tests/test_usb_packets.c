/* Chapter USB: packets of blocks, records and text, and what resets and the bus do to them. */
#include "usb_fixture.h"
#include "vectors.h"

#define FAR 4000000u /* periods: a hundred seconds */

/* Packets on 81 IN --------------------------------------------------------------------------------------------- */

/* Lets the records of a vector wait, by their names. */
static void let_wait(const struct vec_packet *v)
{
    for (size_t i = 0; i < v->record_count; i++) {
        for (size_t k = 0; k < VEC_COUNT(vec_acks); k++) {
            if (strcmp(vec_acks[k].name, v->records[i]) == 0) {
                memcpy(usb.acks[(usb.first_ack + usb.ack_count) % PW_QUEUE_RECORDS], vec_acks[k].bytes, PW_ACK);
                usb.ack_count++;
            }
        }
        for (size_t k = 0; k < VEC_COUNT(vec_statuses); k++) {
            if (strcmp(vec_statuses[k].name, v->records[i]) == 0) {
                memcpy(usb.status, vec_statuses[k].bytes, PW_STATUS);
                usb.status_waits = true;
                usb.before_status = usb.ack_count;
            }
        }
    }
}

static void test_vectors(void)
{
    for (size_t i = 0; i < VEC_COUNT(vec_packets); i++) {
        const struct vec_packet *v = &vec_packets[i];
        for (uint32_t first = 0; first < PW_QUEUE_RECORDS; first++) {
            check_case = v->name;
            begin_configured(true);
            usb.first_ack = first;
            let_wait(v);
            CHECK_EQ(read_packet(PW_USB_RECORDS), v->size == 0u ? PW_USB_NAK : (int)v->size);
            CHECK_BYTES(packet, v->bytes, v->size);
            CHECK_EQ(read_packet(PW_USB_RECORDS), v->size == 512u ? 0 : PW_USB_NAK); /* USB-019 */
            CHECK_EQ(read_packet(PW_USB_RECORDS), PW_USB_NAK);
        }
    }
}

static void test_full_speed_packets(void)
{
    uint8_t last = 0;
    check_case = "records in packets of 64 bytes";
    begin_configured(false);
    for (uint32_t i = 0; i < 5u; i++) {
        CHECK_EQ(send_block(PW_NO_OP, 0), 0);
    }
    pw_usb_suspend(&usb); /* the status record goes behind the five */
    pw_usb_resume(&usb);
    run_ms(1);
    CHECK_EQ(read_packet(PW_USB_RECORDS), 64);
    CHECK_EQ(pw_get32(packet + 4), 1);
    CHECK_EQ(pw_get32(packet + 36), 2);
    CHECK_EQ(send_block(PW_NO_OP, 0), 0); /* and this one behind the status */
    CHECK_EQ(read_packet(PW_USB_RECORDS), 64);
    CHECK_EQ(read_packet(PW_USB_RECORDS), 32);
    CHECK_EQ(pw_get32(packet + 4), 5);
    CHECK_EQ(read_packet(PW_USB_RECORDS), 64);
    CHECK_EQ(packet[1], 'S');
    CHECK_EQ(read_packet(PW_USB_RECORDS), 32);
    CHECK_EQ(pw_get32(packet + 4), 6);
    CHECK_EQ(read_packet(PW_USB_RECORDS), PW_USB_NAK);
    check_case = "an empty packet, or what came up meanwhile";
    CHECK_EQ(send_block(PW_NO_OP, 0), 0);
    CHECK_EQ(send_block(PW_NO_OP, 0), 0);
    CHECK_EQ(read_packet(PW_USB_RECORDS), 64);
    CHECK_EQ(send_block(PW_NO_OP, 0), 0);
    CHECK_EQ(read_packet(PW_USB_RECORDS), 32);
    CHECK_EQ(read_packet(PW_USB_RECORDS), PW_USB_NAK);
    CHECK_EQ(send_block(PW_NO_OP, 0), 0);
    CHECK_EQ(send_block(PW_NO_OP, 0), 0);
    CHECK_EQ(drain(&last), 2);
    CHECK_EQ(last, PW_ACCEPTED);
}

static void test_status_keeps_its_place(void)
{
    check_case = "a status record is not held back by what comes after it";
    begin_configured(true);
    CHECK_EQ(send_block(PW_NO_OP, 0), 0);
    pw_usb_suspend(&usb);
    for (uint32_t i = 0; i < 8u; i++) {
        CHECK_EQ(send_block(PW_NO_OP, 0), 0);
    }
    CHECK_EQ(read_packet(PW_USB_RECORDS), 9 * 32 + 64);
    CHECK_EQ(packet[33], 'S');
    CHECK_EQ(packet[32 + 3], PW_STATE_SUSPENDED);
    check_case = "the newer one takes the place of the older";
    CHECK_EQ(send_block(PW_NO_OP, 0), 0);
    pw_usb_resume(&usb);
    pw_usb_suspend(&usb);
    CHECK_EQ(send_block(PW_NO_OP, 0), 0);
    pw_usb_resume(&usb);
    CHECK_EQ(read_packet(PW_USB_RECORDS), 2 * 32 + 64);
    CHECK_EQ(packet[65], 'S');
    CHECK_EQ(packet[64 + 3], PW_STATE_OFF);
    CHECK_EQ(read_packet(PW_USB_RECORDS), PW_USB_NAK);
}

/* Blocks on 01 OUT --------------------------------------------------------------------------------------------- */

/* Packets of any sizes, against the words of USB-017 and USB-018. */
static void test_any_packets(void)
{
    for (uint32_t round = 0; round < 400u; round++) {
        const bool high_speed = round % 2u == 0u;
        uint8_t block[PW_BLOCK];
        size_t arrived = 0;
        uint32_t whole = 0;
        uint32_t cut = 0;
        uint8_t last = 0;
        check_case = "packets of any size";
        begin_configured(high_speed);
        const size_t most = pw_usb_packet(&usb);
        make_block(block, PW_NO_OP, 0);
        for (uint32_t i = 0; i < 40u && whole + cut < 16u; i++) {
            const uint32_t kind = check_below(8);
            const size_t size = kind == 0u ? check_below((uint32_t)most) : (kind == 1u ? 0u : most);
            CHECK_EQ(pw_usb_out(&usb, PW_USB_BLOCKS, block + arrived, size), 0);
            arrived += size;
            if (arrived == PW_BLOCK) {
                whole++;
                arrived = 0;
                make_block(block, PW_NO_OP, 0);
            } else if (size < most) {
                cut += arrived != 0u ? 1u : 0u;
                arrived = 0;
            } else {
                /* The block goes on. */
            }
        }
        CHECK_EQ(device.accepted, whole);
        CHECK_EQ(device.refused, cut);
        CHECK(cut == 0u || device.last_refusal == PW_LENGTH);
        CHECK_EQ(drain(&last), whole + cut);
    }
}

static void test_arrival(void)
{
    uint8_t block[PW_BLOCK];
    check_case = "a block has arrived with its last byte";
    begin_configured(false);
    make_block(block, PW_CLOCK, 0);
    CHECK_EQ(send_bytes(block, 448), 0);
    run_ms(2);
    const uint64_t tick = pw_device_tick(&device);
    CHECK_EQ(send_bytes(block + 448, 64), 0);
    run_ms(2);
    CHECK_EQ(read_packet(PW_USB_RECORDS), 32);
    CHECK_EQ(pw_get64(packet + 16), tick);
    check_case = "a packet larger than the endpoint's";
    CHECK_EQ(pw_usb_out(&usb, PW_USB_BLOCKS, block, 65), PW_USB_STALLED);
    CHECK_EQ(pw_usb_out(&usb, PW_USB_RECORDS, block, 64), PW_USB_STALLED);
    CHECK_EQ(pw_usb_out(&usb, 0x02, block, 64), PW_USB_STALLED);
    CHECK_EQ(read_packet(PW_USB_BLOCKS), PW_USB_STALLED);
}

static void test_nak_for_records(void)
{
    uint8_t last = 0;
    check_case = "NAK while the records have no room";
    begin_configured(true);
    for (uint32_t i = 0; i < PW_QUEUE_RECORDS; i++) {
        CHECK_EQ(send_block(PW_NO_OP, 0), 0);
    }
    CHECK_EQ(send_block(PW_NO_OP, 0), PW_USB_NAK);
    CHECK_EQ(pw_usb_out(&usb, PW_USB_BLOCKS, packet, 0), PW_USB_NAK);
    CHECK_EQ(device.accepted, PW_QUEUE_RECORDS);
    pw_usb_suspend(&usb);
    pw_usb_resume(&usb); /* a status record has a place beside them */
    CHECK_EQ(read_packet(PW_USB_RECORDS), 512);
    CHECK_EQ(pw_get32(packet + 4), 1);
    CHECK_EQ(send_block(PW_NO_OP, 0), 0);
    CHECK_EQ(drain(&last), PW_QUEUE_RECORDS - 16u + 1u);
    CHECK_EQ(last, PW_ACCEPTED);
    CHECK(!usb.status_waits);
}

static void test_nak_for_the_queue(void)
{
    uint8_t last = 0;
    uint32_t sent = 0;
    check_case = "NAK while the queue has no room";
    begin_configured(true);
    CHECK_EQ(ask(PW_REQ_ENABLE, 0), 0);
    while (sent < 1000u && send_block(PW_UPDATE, FAR + sent * PW_PERIODS_PER_UPDATE) == 0) {
        sent++;
        (void)drain(&last);
        CHECK_EQ(last, PW_ACCEPTED);
    }
    CHECK_EQ(sent, PW_QUEUE_CHANGES);
    CHECK_EQ(send_block(PW_NO_OP, 0), PW_USB_NAK); /* whatever its kind: BLK-009 */
    CHECK_EQ(pw_usb_out(&usb, PW_USB_BLOCKS, packet, 0), 0); /* no block */
    CHECK_EQ(pw_usb_out(&usb, PW_USB_BLOCKS, packet, 7), PW_USB_NAK);
    check_case = "and at full speed within a block";
    usb.high_speed = false;
    CHECK_EQ(ask(PW_REQ_DISABLE, 0), 0);
    run_ms(1);
    CHECK_EQ(send_block(PW_NO_OP, 0), 0);
    CHECK_EQ(drain(&last), 1);
}

static void test_halted_block(void)
{
    uint8_t block[PW_BLOCK];
    uint8_t last = 0;
    check_case = "a part of a block, and halts";
    begin_configured(false);
    make_block(block, PW_NO_OP, 0);
    CHECK_EQ(send_bytes(block, 192), 0);
    CHECK_EQ(request(0x02, 1, 0, 0x81, 0), 0); /* of another endpoint */
    CHECK_EQ(send_bytes(block + 192, 320), 0);
    CHECK_EQ(drain(&last), 1);
    CHECK_EQ(last, PW_ACCEPTED);
    CHECK_EQ(send_block(PW_NO_OP, 0), 0);
    make_block(block, PW_NO_OP, 0);
    CHECK_EQ(send_bytes(block, 192), 0);
    CHECK_EQ(request(0x02, 3, 0, 0x01, 0), 0);
    CHECK_EQ(request(0x02, 3, 0, 0x81, 0), 0);
    CHECK_EQ(send_bytes(block + 192, 320), PW_USB_STALLED);
    CHECK_EQ(read_packet(PW_USB_RECORDS), PW_USB_STALLED);
    CHECK_EQ(request(0x02, 1, 0, 0x01, 0), 0);
    CHECK_EQ(request(0x02, 1, 0, 0x81, 0), 0);
    CHECK_EQ(send_bytes(block, 512), 0); /* the part is forgotten */
    CHECK_EQ(drain(&last), 2);           /* and the record that waited is kept: USB-015 */
    CHECK_EQ(last, PW_ACCEPTED);
    CHECK_EQ(device.refused, 0);
}

/* Resets and the bus ------------------------------------------------------------------------------------------- */

/* Outputs on, a change queued, records that wait here and in the device, part of a block, a halt, DTR. */
static void get_busy(void)
{
    begin_configured(false);
    CHECK_EQ(request(0x21, 0x22, 1, 1, 0), 0);
    pw_usb_suspend(&usb);
    pw_usb_resume(&usb);
    CHECK_EQ(ask(PW_REQ_ENABLE, 0), 0);
    number = 5;
    CHECK_EQ(send_block(PW_UPDATE, FAR), 0);
    CHECK(usb.status_waits);
    device.telling |= 1u << PW_DOOR_USB;
    CHECK_EQ(send_bytes(packet, 64), 0);
    CHECK_EQ(request(0x02, 3, 0, 0x81, 0), 0);
    number = 1; /* one that would not follow */
    CHECK_EQ(usb.ack_count, 1);
    CHECK_EQ(state(), PW_STATE_READY);
}

/* What USB-026 says of a reset. */
static void check_reset(void)
{
    uint8_t last = 0;
    CHECK_EQ(state(), PW_STATE_OFF);
    CHECK_EQ(in[48], PW_QUEUE_CHANGES);
    CHECK_EQ(read_packet(PW_USB_RECORDS), PW_USB_NAK);
    CHECK_EQ(send_block(PW_NO_OP, 0), 0);
    CHECK_EQ(drain(&last), 1);
    CHECK_EQ(last, PW_ACCEPTED);
    CHECK_EQ(device.refused, 0);
    CHECK_EQ(device.lost, 0);
}

static void test_resets(void)
{
    check_case = "SET_CONFIGURATION";
    get_busy();
    CHECK_EQ(set_configuration(1), 0);
    CHECK(!usb.dtr);
    check_reset();
    check_case = "SET_CONFIGURATION 0, then 1";
    get_busy();
    CHECK_EQ(set_configuration(0), 0);
    CHECK_EQ(device.state, PW_STATE_OFF);
    CHECK_EQ(set_configuration(1), 0);
    check_reset();
    check_case = "bus reset";
    get_busy();
    pw_usb_bus_reset(&usb);
    CHECK_EQ(device.state, PW_STATE_OFF);
    CHECK_EQ(read_packet(PW_USB_RECORDS), PW_USB_STALLED);
    CHECK_EQ(set_configuration(1), 0);
    CHECK(!usb.dtr);
    check_reset();
    check_case = "SET_INTERFACE of interface 0";
    get_busy();
    CHECK_EQ(request(0x01, 11, 0, 0, 0), 0);
    CHECK(usb.dtr);
    check_reset();
    check_case = "SET_INTERFACE of the others";
    for (uint16_t interface = 1; interface < 4u; interface++) {
        get_busy();
        CHECK_EQ(request(0x01, 11, 0, interface, 0), 0);
        CHECK_EQ(state(), PW_STATE_READY);
        CHECK_EQ(usb.ack_count, 1);
        CHECK_EQ(usb.arrived, 64);
    }
}

static void test_suspend(void)
{
    uint8_t last = 0;
    check_case = "suspend and resume";
    get_busy();
    CHECK_EQ(request(0x02, 1, 0, 0x81, 0), 0);
    pw_usb_suspend(&usb);
    CHECK_EQ(device.state, PW_STATE_SUSPENDED);
    pw_usb_resume(&usb);
    CHECK_EQ(state(), PW_STATE_OFF);
    CHECK(usb.configured && usb.dtr);
    CHECK_EQ(drain(&last), 1); /* records that wait are kept: USB-020 */
    check_case = "suspend of a bus that has not configured the device";
    begin(true, false);
    pw_usb_suspend(&usb);
    CHECK_EQ(device.state, PW_STATE_OFF);
    check_case = "reset of a suspended bus";
    get_busy();
    pw_usb_suspend(&usb);
    pw_usb_bus_reset(&usb);
    CHECK_EQ(device.state, PW_STATE_OFF);
    CHECK(!device.suspended && !usb.suspended);
    check_case = "unplugged";
    get_busy();
    pw_usb_unplugged(&usb);
    CHECK_EQ(device.state, PW_STATE_OFF);
    CHECK(!usb.configured && !device.suspended);
    pw_usb_suspend(&usb);
    CHECK_EQ(device.state, PW_STATE_OFF);
    pw_usb_bus_reset(&usb);
    CHECK_EQ(set_configuration(1), 0);
    CHECK_EQ(read_packet(PW_USB_RECORDS), PW_USB_NAK);
    check_case = "unplugged while suspended";
    get_busy();
    pw_usb_suspend(&usb);
    pw_usb_unplugged(&usb);
    CHECK_EQ(device.state, PW_STATE_OFF);
    CHECK(!device.suspended);
}

/* The console -------------------------------------------------------------------------------------------------- */

/* Reads 83 IN until NAK; returns how many bytes there were, and counts every "ok" in them. */
static size_t read_text(uint32_t *oks)
{
    uint8_t before = 0;
    size_t total = 0;
    for (int size = read_packet(PW_USB_TEXT_IN); size >= 0; size = read_packet(PW_USB_TEXT_IN)) {
        for (int i = 0; i < size; i++) {
            *oks += before == 'o' && packet[i] == 'k' ? 1u : 0u;
            before = packet[i];
        }
        total += (size_t)size;
    }
    return total;
}

static void test_console(void)
{
    static const uint8_t command[] = "version\r";
    static const uint8_t zero[] = {0};
    uint32_t oks = 0;
    check_case = "text needs DTR";
    begin_configured(false);
    CHECK_EQ(pw_usb_out(&usb, PW_USB_TEXT_OUT, command, sizeof command - 1u), 0);
    CHECK_EQ(read_packet(PW_USB_TEXT_IN), PW_USB_NAK);
    CHECK_EQ(request(0x21, 0x22, 1, 1, 0), 0);
    CHECK_EQ(read_packet(PW_USB_TEXT_IN), PW_USB_NAK);
    CHECK_EQ(pw_usb_out(&usb, PW_USB_TEXT_OUT, command, sizeof command - 1u), 0);
    CHECK_EQ(read_packet(PW_USB_TEXT_IN), 64);
    CHECK(read_text(&oks) != 0u);
    check_case = "frames need none; hanging up ends them";
    begin_configured(true);
    CHECK_EQ(pw_usb_out(&usb, PW_USB_TEXT_OUT, zero, 1), 0);
    CHECK_EQ(read_packet(PW_USB_TEXT_IN), 1);
    CHECK_EQ(packet[0], 0);
    CHECK(line.frames);
    CHECK_EQ(request(0x21, 0x22, 0, 1, 0), 0); /* DTR was low: nothing goes low */
    CHECK(line.frames);
    CHECK_EQ(request(0x21, 0x22, 1, 1, 0), 0);
    CHECK_EQ(request(0x01, 11, 0, 0, 0), 0); /* SET_INTERFACE of interface 0 leaves the line: USB-026 */
    CHECK(line.frames);
    CHECK_EQ(request(0x21, 0x22, 0, 1, 0), 0);
    CHECK(!line.frames);
    CHECK_EQ(pw_usb_out(&usb, PW_USB_TEXT_OUT, zero, 1), 0);
    CHECK_EQ(set_configuration(1), 0);
    CHECK(!line.frames);
}

/* Nobody reads the answers, until the line has no room and the endpoint answers NAK; then all of them come. */
static void test_text_waits(void)
{
    static const uint8_t commands[] = "boards\rversion\r";
    uint32_t sent = 0;
    uint32_t oks = 0;
    check_case = "text that the line has no room for";
    begin_configured(false);
    CHECK_EQ(request(0x21, 0x22, 1, 1, 0), 0);
    while (sent < 100u && pw_usb_out(&usb, PW_USB_TEXT_OUT, commands, sizeof commands - 1u) == 0) {
        sent++;
    }
    CHECK(sent > 1u && sent < 10u);
    CHECK(usb.text_size != 0u);
    CHECK_EQ(send_block(PW_NO_OP, 0), 0); /* blocks go on: USB-025 */
    CHECK_EQ(read_packet(PW_USB_RECORDS), 32);
    CHECK(read_text(&oks) > 2000u);
    pw_usb_poll(&usb);
    CHECK(read_text(&oks) > 20u); /* the answer to what had waited */
    CHECK_EQ(usb.text_size, 0);
    CHECK_EQ(oks, 2u * sent);
}

/* Frames of requests: STATUS, but for the last one. */
static size_t put_requests(uint8_t *to, uint32_t count, uint8_t type, uint8_t code)
{
    size_t size = 0;
    for (uint32_t i = 0; i < count; i++) {
        const bool last = i + 1u == count;
        const uint8_t body[9] = {(uint8_t)i, last ? type : PW_REQUEST_IN, last ? code : PW_REQ_STATUS, 0, 0, 0, 0,
                                 last ? 0u : 64u, 0};
        uint8_t frame[PW_FRAME_MOST];
        const size_t length = pw_frame_encode(frame, PW_FRAME_REQUEST, body, sizeof body);
        memcpy(to + size, frame, length);
        size += length;
    }
    return size;
}

static void test_hang_up(void)
{
    static const uint8_t zero[] = {0};
    uint8_t frames[PW_USB_PACKET];
    uint32_t oks = 0;
    check_case = "what had arrived whole is carried out when the host hangs up";
    begin_configured(true);
    CHECK_EQ(request(0x21, 0x22, 1, 1, 0), 0);
    CHECK_EQ(pw_usb_out(&usb, PW_USB_TEXT_OUT, zero, 1), 0);
    const size_t size = put_requests(frames, 30, PW_REQUEST_OUT, PW_REQ_DISABLE);
    CHECK_EQ(pw_usb_out(&usb, PW_USB_TEXT_OUT, frames, size), 0);
    CHECK_EQ(usb.text_size, 0);
    CHECK_EQ(pw_usb_out(&usb, PW_USB_TEXT_OUT, frames, put_requests(frames, 30, PW_REQUEST_OUT, PW_REQ_ENABLE)), 0);
    CHECK(usb.text_size != 0u);
    CHECK_EQ(pw_usb_out(&usb, PW_USB_TEXT_OUT, zero, 1), PW_USB_NAK);
    CHECK_EQ(device.state, PW_STATE_OFF);
    CHECK_EQ(request(0x21, 0x22, 0, 1, 0), 0);
    CHECK_EQ(usb.text_size, 0);
    CHECK_EQ(device.state, PW_STATE_READY);
    CHECK_EQ(device.dropped_frames, 0);
    CHECK_EQ(request(0x21, 0x22, 1, 1, 0), 0);
    CHECK(read_text(&oks) < 16u);
}

int main(void)
{
    test_vectors();
    test_full_speed_packets();
    test_status_keeps_its_place();
    test_any_packets();
    test_arrival();
    test_nak_for_records();
    test_nak_for_the_queue();
    test_halted_block();
    test_resets();
    test_suspend();
    test_console();
    test_text_waits();
    test_hang_up();
    return check_end();
}
