/* Messages go to processors by their node and answers to the controller, in the order in which they were sent. */
#include "boards.h"

#include <string.h>

#define ROUTE 3u                                       /* bytes of the header: CHN-002 */
#define ROOM_C 30
#define SUPPLY_MV 15000u
#define STALL_TICKS ((uint64_t)PW_TICKS_PER_MS)        /* CHN-028 */
#define LINK_TICKS (1000u * (uint64_t)PW_TICKS_PER_MS) /* CHN-028 */
#define CYCLES_PER_TICK 200u
#define RASTERISE_TICKS 22u                            /* BUD-003 */

void boards_begin(struct boards *self, struct faults *faults, uint64_t now, const uint8_t firmware[3],
                  const uint8_t unique_id[8])
{
    memset(self, 0, sizeof *self);
    self->faults = faults;
    self->powered_at = now;
    for (uint8_t i = 0; i < PW_PROCESSORS; i++) {
        uint8_t own_id[8];
        memcpy(own_id, unique_id, sizeof own_id);
        own_id[0] ^= (uint8_t)(i + 1u);
        pw_processor_begin(&self->processors[i], firmware, own_id);
    }
}

static bool is_dead(struct boards *self, uint64_t now, uint32_t place)
{
    return faults_newest(self->faults, now, MACHINE_DEAD, place) != NULL;
}

bool boards_start_next(struct boards *self, uint64_t now)
{
    if (self->started == PW_PROCESSORS || is_dead(self, now, self->started)) {
        return false;
    }
    self->started++;
    return true;
}

/* Links -------------------------------------------------------------------------------------------------------- */

/* Ticks that so many tokens take to a processor or from it: those of the slowest link on the way. */
static uint64_t link_ticks(struct boards *self, uint64_t now, uint32_t place, uint32_t tokens)
{
    uint64_t slowest = 0;
    for (uint32_t link = 0; link <= place; link++) {
        const struct machine_fault *slow = faults_newest(self->faults, now, MACHINE_SLOW_LINK, link);
        if (slow != NULL && (uint64_t)slow->value > slowest) {
            slowest = (uint64_t)slow->value;
        }
    }
    return slowest * tokens / CYCLES_PER_TICK;
}

/* Adds a message to what its route holds already. Returns whether END has come. */
static bool close_route(struct route *route, const struct message *message)
{
    const uint32_t room = BOARDS_ROUTE - route->size;
    const uint32_t size = message->size < room ? message->size : room; /* too long is too long */
    memcpy(&route->bytes[route->size], message->bytes, size);
    route->size += size;
    route->open = !message->ends;
    return message->ends;
}

/* The message of a route is on its way. False if too many are. */
static bool depart(struct way *way, uint64_t arrives)
{
    if (way->count == BOARDS_WAITING) {
        return false;
    }
    struct arrival *arrival = &way->arrivals[(way->first + way->count) % BOARDS_WAITING];
    way->busy_until = arrives;
    way->count++;
    arrival->tick = arrives;
    arrival->route = way->route;
    way->route.size = 0;
    return true;
}

static uint64_t later(uint64_t a, uint64_t b)
{
    return a > b ? a : b;
}

static bool has_arrived(const struct way *way, uint64_t now)
{
    return way->count != 0u && way->arrivals[way->first].tick <= now;
}

static void take(struct way *way, struct route *route)
{
    *route = way->arrivals[way->first].route;
    way->first = (way->first + 1u) % BOARDS_WAITING;
    way->count--;
}

/* Messages ----------------------------------------------------------------------------------------------------- */

/* Which processor a message is for: the first one without a number takes what is for node FFFF (CHN-022).
   PW_PROCESSORS: nobody can be reached that takes it. */
static uint32_t place_of(struct boards *self, uint64_t now, const uint8_t *message)
{
    const uint16_t node = (uint16_t)(((uint32_t)message[0] << 8) | message[1]);
    for (uint32_t place = 0; place < self->started && !is_dead(self, now, place); place++) {
        const uint8_t number = self->processors[place].number;
        if (node == PW_UNNUMBERED_NODE ? number == PW_NO_NUMBER : number == node) {
            return place;
        }
    }
    return PW_PROCESSORS;
}

bool boards_send(struct boards *self, uint64_t now, const uint8_t *bytes, size_t size)
{
    struct message message = {.ends = true, .size = (uint32_t)size};
    memcpy(message.bytes, bytes, size);
    const uint32_t named = bytes[2] == PW_END_NUMBER ? bytes[ROUTE] : bytes[1];
    if (named < PW_PROCESSORS) {
        faults_damage(self->faults, now, named, &message);
    }
    struct way *way = &self->down;
    if (!close_route(&way->route, &message)) {
        return true;
    }
    const uint32_t place = place_of(self, now, way->route.bytes);
    if (place != PW_PROCESSORS && !self->blocked) {
        const uint64_t arrives = later(now, way->busy_until) + link_ticks(self, now, place, way->route.size + 1u);
        self->blocked = arrives - now > STALL_TICKS || !depart(way, arrives);
    } else {
        self->blocked = true; /* what is for nobody blocks the chain */
    }
    return !self->blocked;
}

/* An answer of a processor to the controller. */
static void answer(struct boards *self, uint64_t now, uint32_t place, const uint8_t *bytes, size_t size, uint64_t wait)
{
    struct message message = {.ends = true, .size = (uint32_t)size};
    memcpy(message.bytes, bytes, size);
    faults_damage(self->faults, now, place, &message);
    struct way *way = &self->up;
    if (close_route(&way->route, &message)) {
        (void)depart(way, later(now + wait, way->busy_until) + link_ticks(self, now, place, way->route.size + 1u));
    }
}

static void reach_processor(struct boards *self, uint64_t now, const struct route *route)
{
    const uint32_t place = place_of(self, now, route->bytes);
    uint8_t bytes[PW_MESSAGE];
    if (place == PW_PROCESSORS) {
        return; /* it died meanwhile */
    }
    const bool cut = place + 1u < PW_PROCESSORS && is_dead(self, now, place + 1u);
    const bool last = cut || place == PW_PROCESSORS - 1u;
    const size_t size = pw_processor_message(&self->processors[place], route->bytes[2], route->bytes + ROUTE,
                                             route->size - ROUTE, last, bytes);
    /* Whoever has no credit from the link behind it waits before it says that it is the last (CHN-023). */
    const uint64_t since = now - self->powered_at;
    const bool waits = cut && route->bytes[2] == PW_END_NUMBER && since < LINK_TICKS;
    if (size != 0u) {
        answer(self, now, place, bytes, size, waits ? LINK_TICKS - since : 0u);
    }
}

bool boards_deliver(struct boards *self, uint64_t now, struct pw_device *device)
{
    bool answered = false;
    bool more = true;
    while (more) {
        struct route route;
        more = true;
        if (has_arrived(&self->down, now)) {
            take(&self->down, &route);
            reach_processor(self, now, &route);
        } else if (has_arrived(&self->up, now)) {
            take(&self->up, &route);
            pw_device_chain(device, route.bytes[2], route.bytes + ROUTE, route.size - ROUTE);
            answered = true;
        } else {
            more = false;
        }
    }
    return answered;
}

uint64_t boards_message_due(const struct boards *self)
{
    const uint64_t down = self->down.count != 0u ? self->down.arrivals[self->down.first].tick : PW_NEVER;
    const uint64_t up = self->up.count != 0u ? self->up.arrivals[self->up.first].tick : PW_NEVER;
    return down < up ? down : up;
}

/* Periods ------------------------------------------------------------------------------------------------------ */

static void feel(struct boards *self, uint64_t now, uint32_t place)
{
    const struct machine_fault *heat = faults_newest(self->faults, now, MACHINE_CELSIUS, place);
    const struct machine_fault *supply = faults_newest(self->faults, now, MACHINE_MILLIVOLTS, place);
    pw_processor_sensors(&self->processors[place], (int8_t)(heat == NULL ? ROOM_C : heat->value),
                         (uint16_t)(supply == NULL ? SUPPLY_MV : (uint32_t)supply->value));
}

/* Whether the words of this period are not ready when it begins. Those of silence need no work. */
static bool is_late(struct boards *self, uint64_t now, uint32_t place)
{
    const uint32_t *words = self->processors[place].words;
    const struct machine_fault *slow = faults_newest(self->faults, now, MACHINE_SLOW, place);
    const uint32_t needs = slow == NULL ? 0u : RASTERISE_TICKS * (uint32_t)slow->value / PW_TICKS;
    const bool differ = memcmp(words, self->words[place], sizeof self->words[place]) != 0;
    const bool silent = pw_all_zero((const uint8_t *)words, sizeof self->words[place]);
    return differ && !silent && self->late[place] < needs;
}

static void play(struct boards *self, uint32_t place, const uint32_t words[PW_TICKS])
{
    if (memcmp(self->words[place], words, sizeof self->words[place]) != 0) {
        memcpy(self->words[place], words, sizeof self->words[place]);
        self->changed = true;
    }
}

static void begin_period(struct boards *self, uint64_t now, uint64_t period)
{
    static const uint32_t LOW[PW_TICKS] = {0};
    self->period = period;
    self->changed = false;
    for (uint32_t i = 0; i < PW_PROCESSORS; i++) {
        struct pw_processor *processor = &self->processors[i];
        /* Without the first pulse its port clock has not started. */
        if (!processor->synced || is_dead(self, now, i)) {
            play(self, i, LOW);
            continue;
        }
        feel(self, now, i);
        if (!pw_processor_period(processor, period)) {
            continue;
        }
        if (is_late(self, now, i)) {
            self->late[i]++;
            pw_processor_overrun(processor);
        } else {
            self->late[i] = 0;
            play(self, i, processor->words);
        }
    }
}

void boards_sync(struct boards *self, uint64_t now)
{
    const bool first = !self->begun;
    if (first) {
        self->begun = true;
        self->origin = now;
    }
    for (uint32_t i = 0; i < PW_PROCESSORS; i++) {
        if (faults_newest(self->faults, now, MACHINE_NO_SYNC, i) == NULL) {
            const int64_t ahead = faults_clock(self->faults, self->origin, now, i);
            pw_processor_sync(&self->processors[i], (uint64_t)((int64_t)(now - self->origin) + ahead));
        }
    }
    if (first) {
        begin_period(self, now, 0);
    }
}

uint64_t boards_period_due(const struct boards *self)
{
    return self->begun ? self->origin + (self->period + 1u) * PW_TICKS : PW_NEVER;
}

void boards_period(struct boards *self, uint64_t now)
{
    begin_period(self, now, self->period + 1u);
}
