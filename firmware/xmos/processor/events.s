# Waiting of the two threads in C: each waits for several things at once and learns which came: a number of
# the enum EVENT_TIME of processor.h.

    .text
    .globl play_events
    .p2align 2
    .type play_events,@function
    .cc_top play_events.function,play_events
# Sets the events up, but for the sync line's, whose pulses are looked for from the first on (`decide_sync`).
play_events:
    ldw r0, dp[play_timer]
    setc res[r0], 9         # after
    ldap r11, .Lplay_time
    setv res[r0], r11
    eeu res[r0]
    ldw r0, dp[play_inbox]
    ldap r11, .Lplay_message
    setv res[r0], r11
    eeu res[r0]
    ldw r0, dp[started_to]
    ldap r11, .Lplay_started
    setv res[r0], r11
    eeu res[r0]
    ldw r0, dp[sync_port]
    ldap r11, .Lplay_sync
    setv res[r0], r11
    ldw r0, dp[temperature_port]
    setc res[r0], 0x19      # not equal to what it was
    ldap r11, .Lplay_temperature
    setv res[r0], r11
    eeu res[r0]
    ldw r0, dp[supply_port]
    setc res[r0], 0x19
    ldap r11, .Lplay_supply
    setv res[r0], r11
    eeu res[r0]
    retsp 0
    .cc_bottom play_events.function

    .globl play_wait
    .p2align 2
    .type play_wait,@function
    .cc_top play_wait.function,play_wait
# r0 a time. It goes before everything else once it has come.
play_wait:
    ldw r1, dp[play_clock]
    in r1, res[r1]
    sub r1, r1, r0
    ldc r2, 0
    lss r1, r1, r2
    bf r1, .Lplay_time
    ldw r1, dp[play_timer]
    setd res[r1], r0
    waiteu
.Lplay_time:
    ldc r0, 0               # EVENT_TIME
    retsp 0
.Lplay_message:
    ldc r0, 1               # EVENT_MESSAGE
    retsp 0
.Lplay_started:
    ldc r0, 2               # EVENT_STARTED
    retsp 0
.Lplay_sync:
    ldc r0, 3               # EVENT_SYNC
    retsp 0
.Lplay_temperature:
    ldc r0, 4               # EVENT_TEMPERATURE
    retsp 0
.Lplay_supply:
    ldc r0, 5               # EVENT_SUPPLY
    retsp 0
    .cc_bottom play_wait.function

    .globl handle_events
    .p2align 2
    .type handle_events,@function
    .cc_top handle_events.function,handle_events
handle_events:
    ldw r0, dp[handle_timer]
    setc res[r0], 9
    ldap r11, .Lhandle_time
    setv res[r0], r11
    eeu res[r0]
    ldw r0, dp[handle_inbox]
    ldap r11, .Lhandle_message
    setv res[r0], r11
    eeu res[r0]
    retsp 0
    .cc_bottom handle_events.function

    .globl handle_wait
    .p2align 2
    .type handle_wait,@function
    .cc_top handle_wait.function,handle_wait
# r0 a time.
handle_wait:
    ldw r1, dp[handle_timer]
    setd res[r1], r0
    waiteu
.Lhandle_time:
    ldc r0, 0               # EVENT_TIME
    retsp 0
.Lhandle_message:
    ldc r0, 1               # EVENT_MESSAGE
    retsp 0
    .cc_bottom handle_wait.function
