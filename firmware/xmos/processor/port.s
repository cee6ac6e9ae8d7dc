# The port's thread: a word on the pins each tick, 50 to a period, in step with all other processors (TIM-003, CHN-026).
#
# All wait for the sync line and start their clocks with its first pulse. The port changes at the falling edges of its
# clock, the first of which comes one tick later. So the first word that it gets is that of tick 1, and period 0 has one
# less; it is silent anyway.

    .set PERIOD_TIME, 2500  # of timers: 10 ns
    .set TAKE_TIME, 60

    .section .dp.bss.port,"awd",@nobits
    .p2align 2
    .globl first_time
first_time:
    .long 0
    .globl first_stamp
first_stamp:
    .long 0

    .text
    .globl port
    .p2align 2
    .type port,@function
    .cc_top port.function,port
port:
    ldw r0, dp[output_port]
    ldw r4, dp[sync_port]
    ldw r5, dp[output_clock]
    ldw r6, dp[port_clock]
    ldw r7, dp[started_from]
    ldc r2, 0
    out res[r0], r2         # tick 1
    in r3, res[r4]          # the line is high
    setc res[r5], 0xF       # start
    in r8, res[r6]
    getts r3, res[r4]
    stw r3, dp[first_stamp]
    stw r8, dp[first_time]
    outct res[r7], 1
    # The next table is asked for as late as a processor that is slow eight times can bear: 240 cycles before a
    # boundary.
    setc res[r6], 9         # after
    ldc r10, PERIOD_TIME
    ldc r3, TAKE_TIME
    add r8, r8, r10
    sub r8, r8, r3
    ldc r3, 48
.Lsilent:
    out res[r0], r2
    sub r3, r3, 1
    bt r3, .Lsilent
.Lperiod:
    setd res[r6], r8
    in r3, res[r6]
    add r8, r8, r10
    ldw r1, dp[next_table]
    ldc r3, 5
.Lten:
    ldw r2, r1[0]
    out res[r0], r2
    ldw r2, r1[1]
    out res[r0], r2
    ldw r2, r1[2]
    out res[r0], r2
    ldw r2, r1[3]
    out res[r0], r2
    ldw r2, r1[4]
    out res[r0], r2
    ldw r2, r1[5]
    out res[r0], r2
    ldw r2, r1[6]
    out res[r0], r2
    ldw r2, r1[7]
    out res[r0], r2
    ldw r2, r1[8]
    out res[r0], r2
    ldw r2, r1[9]
    out res[r0], r2
    ldaw r1, r1[10]
    sub r3, r3, 1
    bt r3, .Lten
    bu .Lperiod
    .cc_bottom port.function
