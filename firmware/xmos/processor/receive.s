# The receiving thread: takes messages as fast as links bring them, which is 8 cycles a token, two instructions
# (CHN-020).
#
# Each message lies in a place of a ring until the thread that deals with it has done so. That thread says so with an
# END; this one gives it the next message with an END, at once or when there is one. A message that has not exactly
# its tokens or whose CRC-32 is wrong is counted and goes no further (CHN-010); that of a commit is looked at by the
# playing thread. Of a good message the CRC is -1 when its own has come in, so that with END, which is 1, the sum is
# 0. The kinds of messages are the enum SLICE of processor.h.
#
# r4 polynomial; r5 and r6 places for the next message to play and to handle; r7 and r8 the channel ends that give
# messages to these threads; r9 and r10, of these rings: 1 if their thread waits for a message and there is none, 0 if
# it has one and no other waits, -n if n wait besides. r11 the channel end of the event. r3 the CRC-32; r2 the last
# words of the place.

    .set POLYNOMIAL, 0xEDB88320
    .set CRC_BEGIN, 0x9226F562
    .set PLAY_FULL, 6          # so many wait: of 8 places one is being dealt with, one is being filled
    .set HANDLE_FULL, 11       # of 13

    .section .cp.rodata.receive,"ac",@progbits
    .p2align 2
polynomial:
    .long POLYNOMIAL
crc_begin:
    .long CRC_BEGIN
number_crc:
    .long 0xFFF90000        # the complement of FF FF 06 00

    .section .dp.bss.receive,"awd",@nobits
    .p2align 2
    .globl damaged_received
damaged_received:
    .long 0
    .globl heard
heard:
    .long 0

# What r0 has goes on at a handler when something has come to it.
    .macro EVENT handler
    ldap r11, \handler
    setv res[r0], r11
    mov r11, r0
    setev res[r0], r11
    eeu res[r0]
    .endm

# Four bytes of a message into r1, the first as the low one, unless a control token comes before.
    .macro TAKE_WORD
    testwct r0, res[r11]
    bt r0, .Lbad
    in r1, res[r11]
    byterev r1, r1
    .endm

# The same, stored and counted in the CRC.
    .macro KEEP_WORD place
    TAKE_WORD
    stw r1, \place
    crc32 r3, r1, r4
    .endm

    .macro TAKE_BYTE
    testct r0, res[r11]
    bt r0, .Lbad
    int r1, res[r11]
    .endm

# The control token that must come now, into r0.
    .macro TAKE_CONTROL
    testct r0, res[r11]
    bf r0, .Lbad
    inct r0, res[r11]
    .endm

# Another message, of the kind in r0, is in a ring; its thread is told if it waits. Then comes the next event.
    .macro GIVE ring, places, busy, thread
    stw r0, r2[3]
    ldw \ring, r2[4]
    sub \places, \places, 1
    bt \places, \busy
    outct res[\thread], 1
    waiteu
    .endm

    .text
    .globl receive
    .p2align 2
    .type receive,@function
    .cc_top receive.function,receive
receive:
    ldw r4, cp[polynomial]
    ldaw r5, dp[play_ring]
    ldaw r6, dp[handle_ring]
    ldw r7, dp[receive_play]
    ldw r8, dp[receive_handle]
    mkmsk r9, 1
    mkmsk r10, 1
    ldw r0, dp[message_ends+0]
    EVENT .Lslice
    ldw r0, dp[message_ends+4]
    EVENT .Lcommit
    ldw r0, dp[message_ends+8]
    EVENT .Lload
    ldw r0, dp[message_ends+12]
    EVENT .Lprogram
    ldw r0, dp[message_ends+16]
    EVENT .Lcollect
    ldw r0, dp[message_ends+20]
    EVENT .Lnumber
    # What comes to the other channel ends is for nobody.
    ldc r1, 6
    ldaw r2, dp[message_ends]
    ldc r3, MESSAGE_ENDS
.Lothers:
    ldw r0, r2[r1]
    EVENT .Lbad
    add r1, r1, 1
    lsu r0, r1, r3
    bt r0, .Lothers
    ldw r0, dp[receive_play_ready]
    EVENT .Lplay_ready
    ldw r0, dp[receive_handle_ready]
    EVENT .Lhandle_ready
    waiteu

# A thread is done with a message.
.Lplay_ready:
    get r11, ed
    inct r0, res[r11]
    eq r0, r9, 0
    add r9, r9, 1
    bt r0, .Lwait
    outct res[r7], 1
    waiteu
.Lhandle_ready:
    get r11, ed
    inct r0, res[r11]
    eq r0, r10, 0
    add r10, r10, 1
    bt r0, .Lwait
    outct res[r8], 1
.Lwait:
    waiteu

# A thread has another message. If its ring is full now the links must wait until it is done with that.
.Lplay_busy:
    add r0, r9, PLAY_FULL
    bt r0, .Lwait
    ldw r11, dp[receive_play_ready]
    inct r0, res[r11]
    add r9, r9, 1
    outct res[r7], 1
    waiteu
.Lhandle_busy:
    add r0, r10, HANDLE_FULL
    bt r0, .Lwait
    ldw r11, dp[receive_handle_ready]
    inct r0, res[r11]
    add r10, r10, 1
    outct res[r8], 1
    waiteu

# A message that is too short or too long, or for nobody: up to its END.
.Lbad:
    get r11, ed
.Ldrain:
    testwct r0, res[r11]
    bt r0, .Ldrain_token
    in r0, res[r11]
    bu .Ldrain
.Ldrain_token:
    testct r0, res[r11]
    bt r0, .Ldrain_control
    int r0, res[r11]
    bu .Ldrain_token
.Ldrain_control:
    inct r0, res[r11]
# A control token has come, in r0.
.Ldamaged:
    eq r0, r0, 1
    bf r0, .Ldrain
.Lcount_damaged:
    ldw r0, dp[damaged_received]
    add r0, r0, 1
    stw r0, dp[damaged_received]
    waiteu

# Its CRC goes on in that of its commit.
.Lslice:
    get r11, ed
    ldaw r2, r5[11]
    ldw r3, cp[crc_begin]
    KEEP_WORD r5[0]
    KEEP_WORD r5[1]
    KEEP_WORD r5[2]
    KEEP_WORD r5[3]
    KEEP_WORD r5[4]
    KEEP_WORD r5[5]
    KEEP_WORD r5[6]
    KEEP_WORD r5[7]
    KEEP_WORD r5[8]
    KEEP_WORD r5[9]
    KEEP_WORD r5[10]
    KEEP_WORD r5[11]
    TAKE_CONTROL
    eq r0, r0, 1
    bf r0, .Lbad
    stw r3, r2[1]
    ldc r0, 1               # SLICE
    GIVE r5, r9, .Lplay_busy, r7

.Lcommit:
    get r11, ed
    ldaw r2, r5[11]
    TAKE_WORD
    stw r1, r5[0]
    TAKE_WORD
    stw r1, r5[1]
    TAKE_WORD
    stw r1, r5[2]
    TAKE_CONTROL
    eq r0, r0, 1
    bf r0, .Lbad
    ldc r0, 2               # COMMIT
    GIVE r5, r9, .Lplay_busy, r7

.Lprogram:
    get r11, ed
    ldaw r2, r5[11]
    TAKE_BYTE
    stw r1, r5[0]
    shl r1, r1, 24
    ldw r3, dp[program_crc]
    xor r3, r3, r1
    KEEP_WORD r5[1]
    KEEP_WORD r5[2]
    KEEP_WORD r5[3]
    KEEP_WORD r5[4]
    KEEP_WORD r5[5]
    TAKE_CONTROL
    add r3, r3, r0
    bt r3, .Ldamaged
    ldc r0, 4               # PROGRAM
    GIVE r5, r9, .Lplay_busy, r7

.Lload:
    get r11, ed
    ldaw r2, r6[11]
    ldw r3, dp[load_crc]
    KEEP_WORD r6[0]
    KEEP_WORD r6[1]
    KEEP_WORD r6[2]
    KEEP_WORD r6[3]
    KEEP_WORD r6[4]
    KEEP_WORD r6[5]
    KEEP_WORD r6[6]
    KEEP_WORD r6[7]
    KEEP_WORD r6[8]
    KEEP_WORD r6[9]
    KEEP_WORD r6[10]
    KEEP_WORD r6[11]
    KEEP_WORD r2[1]
    KEEP_WORD r2[2]
    TAKE_CONTROL
    add r3, r3, r0
    bt r3, .Ldamaged
    ldc r0, 3               # LOAD
    GIVE r6, r10, .Lhandle_busy, r8

# A question. One that asks for something is a sign of life (CHN-018), however long its answer may have to wait.
.Lcollect:
    get r11, ed
    TAKE_BYTE
    stw r1, r6[0]
    sub r2, r1, 7           # REPORT, 7, or PLAYING, 8: 0 or 1
    shr r2, r2, 1
    shl r1, r1, 24
    ldw r3, dp[collect_crc]
    xor r3, r3, r1
    TAKE_WORD
    crc32 r3, r1, r4
    TAKE_CONTROL
    add r3, r3, r0
    or r3, r3, r2
    bt r3, .Ldamaged
    ldw r0, dp[receive_clock]
    in r0, res[r0]
    stw r0, dp[heard]
    ldaw r2, r6[11]
    ldc r0, 5               # COLLECT
    GIVE r6, r10, .Lhandle_busy, r8

.Lnumber:
    get r11, ed
    ldaw r2, r6[11]
    TAKE_BYTE
    stw r1, r6[0]
    shl r1, r1, 24
    ldw r3, cp[number_crc]
    xor r3, r3, r1
    KEEP_WORD r6[1]
    TAKE_CONTROL
    add r3, r3, r0
    bt r3, .Ldamaged
    ldc r0, 6               # NUMBER
    GIVE r6, r10, .Lhandle_busy, r8
    .cc_bottom receive.function
