/* Chapter USB: descriptors and requests, by the vectors and by what the clauses say of states. */
#include "usb_fixture.h"
#include "vectors.h"

/* The device of the vectors ------------------------------------------------------------------------------------ */

static void test_descriptors(void)
{
    for (size_t i = 0; i < VEC_COUNT(vec_descriptors); i++) {
        const struct vec_descriptor *v = &vec_descriptors[i];
        const struct pw_setup setup = setup_of(v->setup);
        const bool reason = v->dfu_mode && (setup.value >> 8) == 3u && (setup.value & 0xFFu) > 16u;
        check_case = v->name;
        begin(v->high_speed, v->dfu_mode);
        const int answer = request(setup.type, setup.request, setup.value, setup.index, setup.length);
        if (v->bytes == NULL) {
            CHECK_EQ(answer, PW_USB_STALLED);
        } else if (reason) {
            CHECK(answer > 2 && in[0] == answer && in[1] == 3); /* the words are the device's own: DFU-012 */
        } else {
            CHECK_EQ(answer, v->size);
            CHECK_BYTES(in, v->bytes, v->size);
        }
    }
}

static void test_lengths(void)
{
    check_case = "the first bytes of a descriptor";
    begin(true, false);
    for (uint16_t length = 0; length < 130u; length++) {
        CHECK_EQ(request(0x80, 6, 0x0200, 0, length), length < 116u ? length : 116);
    }
    CHECK_EQ(request(0x80, 6, 0x0300, 0x0409, 255), 4); /* string 0 in any language */
    CHECK_EQ(request(0x80, 6, 0x0100, 1, 18), PW_USB_STALLED);
    CHECK_EQ(request(0x81, 6, 0x0100, 0, 18), PW_USB_STALLED);
    CHECK_EQ(request(0xC0, 0x20, 0, 7, 10), 10);
    CHECK_EQ(request(0xC0, 0x20, 1, 7, 338), PW_USB_STALLED);
    CHECK_EQ(request(0xC0, 0x21, 0, 7, 338), PW_USB_STALLED);
}

static void test_requests(void)
{
    for (size_t i = 0; i < VEC_COUNT(vec_requests); i++) {
        const struct vec_setup *v = &vec_requests[i];
        const struct pw_setup setup = setup_of(v->bytes);
        check_case = v->name;
        CHECK_EQ(setup.type, v->fields[0]);
        CHECK_EQ(setup.request, v->fields[1]);
        CHECK_EQ(setup.value, v->fields[2]);
        CHECK_EQ(setup.index, v->fields[3]);
        CHECK_EQ(setup.length, v->fields[4]);
        begin_configured(true);
        CHECK_EQ(state(), PW_STATE_OFF);
        CHECK_EQ(request(setup.type, setup.request, setup.value, setup.index, setup.length), v->answer);
    }
    for (size_t i = 0; i < VEC_COUNT(vec_refused_requests); i++) {
        const struct vec_setup *v = &vec_refused_requests[i];
        const struct pw_setup setup = setup_of(v->bytes);
        check_case = v->name;
        begin_configured(true);
        CHECK_EQ(request(setup.type, setup.request, setup.value, setup.index, setup.length), PW_USB_STALLED);
        CHECK_EQ(state(), PW_STATE_OFF);
        CHECK_EQ(request(0x80, 8, 0, 0, 1), 1);
        CHECK_EQ(in[0], 1);
    }
}

static void test_wiring(void)
{
    for (size_t i = 0; i < VEC_COUNT(vec_wirings); i++) {
        check_case = vec_wirings[i].name;
        begin_configured(false);
        memcpy(wiring, vec_wirings[i].channels, sizeof wiring);
        CHECK_EQ(request(PW_REQUEST_IN, PW_REQ_WIRING, 0, 0, 640), 640);
        for (uint32_t k = 0; k < PW_CHANNELS; k++) {
            CHECK_EQ(pw_get16(in + 2u * k), wiring[k]);
        }
    }
}

/* Configured or not -------------------------------------------------------------------------------------------- */

static void test_unconfigured(void)
{
    check_case = "not configured";
    for (uint32_t dfu_mode = 0; dfu_mode < 2u; dfu_mode++) {
        begin(true, dfu_mode == 1u);
        CHECK_EQ(request(PW_REQUEST_IN, PW_REQ_INFO, 0, 0, 64), PW_USB_STALLED); /* REQ-001 */
        CHECK_EQ(ask(PW_REQ_ENABLE, 0), PW_USB_STALLED);
        CHECK_EQ(request(0x81, 0, 0, 0, 2), PW_USB_STALLED);
        CHECK_EQ(request(0x81, 10, 0, 0, 1), PW_USB_STALLED);
        CHECK_EQ(request(0x01, 11, 0, 0, 0), PW_USB_STALLED);
        CHECK_EQ(request(0x82, 0, 0, 1, 2), PW_USB_STALLED);
        CHECK_EQ(request(0x02, 3, 0, 1, 0), PW_USB_STALLED);
        CHECK_EQ(request(0xA1, 0x21, 0, 1, 7), PW_USB_STALLED);
        CHECK_EQ(request(0xA1, 5, 0, dfu_mode == 1u ? 0 : 3, 1), PW_USB_STALLED);
        CHECK_EQ(request(0x82, 0, 0, 0, 2), 2); /* the control endpoint */
        CHECK_EQ(request(0x80, 0, 0, 0, 2), 2);
        CHECK_EQ(pw_get16(in), 1); /* self-powered */
        CHECK_EQ(request(0x80, 8, 0, 0, 1), 1);
        CHECK_EQ(in[0], 0);
        CHECK(!usb.was_configured);
        CHECK_EQ(pw_usb_out(&usb, PW_USB_BLOCKS, in, 512), PW_USB_STALLED);
        CHECK_EQ(read_packet(PW_USB_RECORDS), PW_USB_STALLED);
        CHECK_EQ(set_configuration(1), 0);
        CHECK(usb.was_configured);
        CHECK_EQ(request(0x80, 8, 0, 0, 1), 1);
        CHECK_EQ(in[0], 1);
        CHECK_EQ(set_configuration(0), 0);
        CHECK_EQ(request(0x81, 10, 0, 0, 1), PW_USB_STALLED);
        CHECK(usb.was_configured);
    }
}

static void test_standard(void)
{
    check_case = "standard requests";
    begin_configured(true);
    for (uint16_t interface = 0; interface < 4u; interface++) {
        CHECK_EQ(request(0x81, 0, 0, interface, 2), 2);
        CHECK_EQ(pw_get16(in), 0);
        CHECK_EQ(request(0x81, 10, 0, interface, 1), 1);
        CHECK_EQ(in[0], 0);
        CHECK_EQ(request(0x01, 11, 0, interface, 0), 0);
        CHECK_EQ(request(0x01, 11, 1, interface, 0), PW_USB_STALLED);
        CHECK_EQ(request(0x01, 3, 0, interface, 0), PW_USB_STALLED);
    }
    CHECK_EQ(request(0x81, 0, 0, 4, 2), PW_USB_STALLED);
    CHECK_EQ(request(0x00, 5, 77, 0, 0), 0);
    CHECK_EQ(usb.address, 77);
    CHECK_EQ(request(0x00, 5, 128, 0, 0), PW_USB_STALLED);
    CHECK_EQ(request(0x00, 3, 1, 0, 0), PW_USB_STALLED); /* remote wake-up: USB-021 */
    CHECK_EQ(request(0x00, 1, 1, 0, 0), PW_USB_STALLED);
    CHECK_EQ(request(0x82, 12, 0, 1, 2), PW_USB_STALLED); /* SYNCH_FRAME */
    CHECK_EQ(request(0x00, 3, 2, 0x0600, 0), PW_USB_STALLED);
    CHECK_EQ(request(0x00, 3, 2, 0x0401, 0), PW_USB_STALLED);
    CHECK_EQ(usb.test_mode, 0);
    CHECK_EQ(request(0x00, 3, 2, 0x0400, 0), 0);
    CHECK_EQ(usb.test_mode, 4);
    CHECK_EQ(set_configuration(0x0101), PW_USB_STALLED);
    CHECK_EQ(request(0x40, 4, 0, 0, 0), PW_USB_STALLED); /* to the device, not to interface 0 */
    CHECK_EQ(request(0x02, 3, 0, 0, 0), PW_USB_STALLED); /* the control endpoint is never halted */
    pw_usb_bus_reset(&usb);
    CHECK_EQ(usb.address, 0);
}

static void test_halts(void)
{
    static const uint8_t endpoints[] = {0x01, 0x81, 0x82, 0x03, 0x83};
    check_case = "halts";
    begin_configured(true);
    for (size_t i = 0; i < sizeof endpoints; i++) {
        const uint8_t endpoint = endpoints[i];
        usb.toggles = 0;
        for (size_t k = 0; k < sizeof endpoints; k++) {
            CHECK_EQ(request(0x82, 0, 0, endpoints[k], 2), 2);
            CHECK_EQ(pw_get16(in), 0);
        }
        CHECK_EQ(request(0x02, 3, 0, endpoint, 0), 0);
        CHECK_EQ(request(0x82, 0, 0, endpoint, 2), 2);
        CHECK_EQ(pw_get16(in), 1);
        const bool is_in = (endpoint & 0x80u) != 0u;
        CHECK_EQ(is_in ? read_packet(endpoint) : pw_usb_out(&usb, endpoint, packet, 0), PW_USB_STALLED);
        CHECK_EQ(usb.toggles, 0);
        CHECK_EQ(request(0x02, 1, 0, endpoint, 0), 0);
        CHECK_EQ(usb.toggles, pw_usb_bit(&usb, endpoint));
        CHECK_EQ(is_in ? read_packet(endpoint) : pw_usb_out(&usb, endpoint, packet, 0), is_in ? PW_USB_NAK : 0);
    }
    CHECK_EQ(request(0x02, 3, 0, 0x02, 0), PW_USB_STALLED);
    CHECK_EQ(request(0x02, 3, 0, 0x0101, 0), PW_USB_STALLED);
    CHECK_EQ(request(0x02, 3, 1, 0x01, 0), PW_USB_STALLED);
    check_case = "SET_INTERFACE ends the halts of its own endpoints";
    for (uint16_t interface = 0; interface < 4u; interface++) {
        static const uint8_t own[] = {0x03, 0x04, 0x18, 0x00};
        usb.halts = 0x1F;
        usb.toggles = 0;
        CHECK_EQ(request(0x01, 11, 0, interface, 0), 0);
        CHECK_EQ(usb.halts, 0x1Fu & (unsigned)~own[interface]);
        CHECK_EQ(usb.toggles, own[interface]);
    }
}

/* The console's requests, and DFU at run time ------------------------------------------------------------------ */

static void test_line_coding(void)
{
    static const uint8_t first[] = {0x00, 0xC2, 0x01, 0x00, 0, 0, 8};
    static const uint8_t coding[] = {0x80, 0x25, 0x00, 0x00, 2, 1, 7};
    const struct pw_setup setup = {0x21, 0x20, 0, 1, 7};
    check_case = "line coding";
    begin_configured(true);
    CHECK_EQ(request(0xA1, 0x21, 0, 1, 7), 7);
    CHECK_BYTES(in, first, 7);
    CHECK_EQ(pw_usb_control(&usb, &setup, coding, in), 0);
    CHECK_EQ(request(0x01, 11, 0, 0, 0), 0); /* SET_INTERFACE leaves it: USB-026 */
    CHECK_EQ(request(0xA1, 0x21, 0, 1, 7), 7);
    CHECK_BYTES(in, coding, 7);
    CHECK_EQ(request(0xA1, 0x21, 0, 2, 7), PW_USB_STALLED);
    CHECK_EQ(request(0x21, 0x20, 0, 1, 0), PW_USB_STALLED);
    CHECK_EQ(request(0x21, 0x23, 0, 1, 0), PW_USB_STALLED); /* SEND_BREAK */
    CHECK_EQ(request(0x21, 0x22, 3, 1, 0), 0);
    CHECK(usb.dtr && line.may_text);
    CHECK_EQ(set_configuration(1), 0);
    CHECK(!usb.dtr && !line.may_text);
    CHECK_EQ(request(0xA1, 0x21, 0, 1, 7), 7);
    CHECK_BYTES(in, first, 7);
}

static void test_detach(void)
{
    static const uint8_t idle[] = {0, 0, 0, 0, PW_DFU_APP_IDLE, 0};
    static const uint8_t detached[] = {0, 0, 0, 0, PW_DFU_APP_DETACH, 0};
    check_case = "DFU at run time";
    begin_configured(true);
    CHECK_EQ(request(0xA1, 3, 0, 3, 6), 6);
    CHECK_BYTES(in, idle, 6);
    for (uint8_t code = 0; code < 8u; code++) {
        const bool known = code == PW_DFU_GETSTATUS || code == PW_DFU_GETSTATE;
        CHECK_EQ(request(0xA1, code, 0, 3, 64), known ? (code == PW_DFU_GETSTATE ? 1 : 6) : PW_USB_STALLED);
        CHECK_EQ(code == 0u ? PW_USB_STALLED : request(0x21, code, 0, 3, 0), PW_USB_STALLED);
    }
    CHECK_EQ(ask(PW_REQ_ENABLE, 0), 0);
    CHECK_EQ(request(0x21, 0, 1000, 3, 0), 0);
    CHECK_EQ(state(), PW_STATE_DFU);
    CHECK_EQ(request(0xA1, 3, 0, 3, 6), 6);
    CHECK_BYTES(in, detached, 6);
    CHECK_EQ(request(0xA1, 5, 0, 3, 1), 1);
    CHECK_EQ(in[0], PW_DFU_APP_DETACH);
    CHECK_EQ(request(0x21, 0, 1000, 3, 0), PW_USB_STALLED); /* DFU-006: not drawn */
    CHECK_EQ(request(0xA1, 5, 0, 3, 1), 1);
    CHECK_EQ(in[0], PW_DFU_APP_IDLE);
    run_ms(9);
    CHECK_EQ(pw_device_leaving(&device), PW_STAY); /* DFU-002: 10 to 1000 ms */
    run_ms(991);
    CHECK_EQ(pw_device_leaving(&device), PW_LEAVE_DFU);
}

static void test_dfu_mode(void)
{
    check_case = "DFU mode";
    begin(true, true);
    pw_usb_bus_reset(&usb);
    CHECK(!pw_dfu_leaves(&dfu)); /* resets belong to enumeration: DFU-015 */
    CHECK_EQ(set_configuration(1), 0);
    CHECK_EQ(request(0x81, 10, 0, 0, 1), 1);
    CHECK_EQ(request(0x01, 11, 0, 0, 0), 0);
    CHECK_EQ(request(0x01, 11, 0, 1, 0), PW_USB_STALLED);
    CHECK_EQ(request(0x82, 0, 0, 1, 2), PW_USB_STALLED); /* no endpoints */
    CHECK_EQ(request(PW_REQUEST_IN, PW_REQ_INFO, 0, 0, 64), PW_USB_STALLED);
    CHECK_EQ(request(0xA1, 5, 0, 1, 1), PW_USB_STALLED);
    CHECK_EQ(request(0xA1, 5, 0, 0, 1), 1);
    CHECK_EQ(in[0], PW_DFU_IDLE);
    CHECK_EQ(request(0xA1, 3, 0, 0, 6), 6);
    CHECK_EQ(request(0x21, 0, 0, 0, 0), PW_USB_STALLED);
    CHECK_EQ(request(0xA1, 5, 0, 0, 1), 1);
    CHECK_EQ(in[0], PW_DFU_ERROR);
    CHECK_EQ(pw_usb_out(&usb, PW_USB_BLOCKS, in, 64), PW_USB_STALLED);
    pw_usb_poll(&usb);
    pw_usb_suspend(&usb);
    pw_usb_resume(&usb);
    pw_usb_bus_reset(&usb);
    CHECK(pw_dfu_leaves(&dfu));
}

/* Answers that come later -------------------------------------------------------------------------------------- */

static void test_pulses(void)
{
    const struct pw_setup setup = {PW_REQUEST_IN, PW_REQ_PULSES, 0, 0, 496};
    uint16_t size = 0;
    check_case = "PULSES";
    begin_configured(true);
    CHECK_EQ(pw_usb_control(&usb, &setup, NULL, in), PW_USB_NAK);
    CHECK_EQ(pw_usb_control_again(&usb, in), PW_USB_NAK);
    run_ms(3);
    CHECK_EQ(pw_usb_control_again(&usb, in), 496);
    CHECK_EQ(pw_usb_control_again(&usb, in), PW_USB_STALLED); /* nothing waits */
    CHECK_EQ(request(PW_REQUEST_IN, PW_REQ_PULSES, 0, 0, 20), 20);
    check_case = "PULSES, given up for another request";
    CHECK_EQ(pw_usb_control(&usb, &setup, NULL, in), PW_USB_NAK);
    CHECK_EQ(request(0x80, 8, 0, 0, 1), 1);
    CHECK_EQ(pw_usb_control_again(&usb, in), PW_USB_STALLED);
    CHECK_EQ(request(PW_REQUEST_IN, PW_REQ_PULSES, 0, 0, 496), 496);
    check_case = "PULSES, and a bus reset";
    CHECK_EQ(pw_usb_control(&usb, &setup, NULL, in), PW_USB_NAK);
    pw_usb_bus_reset(&usb);
    CHECK_EQ(pw_usb_control_again(&usb, in), PW_USB_STALLED);
    CHECK_EQ(set_configuration(1), 0);
    run_ms(3);
    check_case = "PULSES, given up";
    CHECK_EQ(pw_usb_control(&usb, &setup, NULL, in), PW_USB_NAK);
    pw_usb_give_up(&usb);
    run_ms(10);
    CHECK(!device.reading);
    check_case = "PULSES while another door reads";
    CHECK_EQ(pw_device_request(&device, PW_DOOR_LINE(0), &setup, in, &size), PW_LATER);
    CHECK_EQ(pw_usb_control(&usb, &setup, NULL, in), PW_USB_NAK);
    run_ms(3);
    CHECK_EQ(pw_usb_control_again(&usb, in), PW_USB_NAK);
    CHECK_EQ(pw_device_answer(&device, PW_DOOR_LINE(0), in, &size), PW_ANSWERED);
    CHECK_EQ(pw_usb_control_again(&usb, in), PW_USB_NAK);
    run_ms(3);
    CHECK_EQ(pw_usb_control_again(&usb, in), 496);
}

int main(void)
{
    test_descriptors();
    test_lengths();
    test_requests();
    test_wiring();
    test_unconfigured();
    test_standard();
    test_halts();
    test_line_coding();
    test_detach();
    test_dfu_mode();
    test_pulses();
    return check_end();
}
