# From pulses to the words of a port (PUL-004, PUL-005, PUL-006).
#
# Two tables give the ticks in which each packed pulse begins and ends. What is no pulse begins and ends at tick 0. First
# each tick gets its edges: the bits that rise there less the bits that fall, as a number. Then each word is the one
# before it and these: at every tick a bit is 0 or 1, so that nothing is carried from one bit to the next. The first word
# needs the bits of the pulses that go round the end of the period: those that end before they begin.
#
# Addition is a short instruction and exclusive or is not, so that this way more of them are there when they are needed.

    .text
    .globl raster_begin
    .p2align 2
    .type raster_begin,@function
    .cc_top raster_begin.function,raster_begin
# r0 slice, r1 row of widths or 0, r2 edges, which are 0, r3 table; returns the levels after 2 words.
#
# While pulses are taken: r0 slice, or the row of widths; r1 edges; r2 and r3 tables of begins and ends; r4 the bit;
# r5 levels, each pulse shifted in at the low end; r6 a packed pulse; r7 and r8 its begin and end; r9 mask of 12 bits;
# r10 the rest of a word of the slice; r11 12.
raster_begin:
    entsp 10
    stw r4, sp[1]
    stw r5, sp[2]
    stw r6, sp[3]
    stw r7, sp[4]
    stw r8, sp[5]
    stw r9, sp[6]
    stw r10, sp[7]
    stw r0, sp[8]
    stw r3, sp[9]
    mov r10, r1
    mov r1, r2
    ldaw r2, dp[pulse_begins]
    ldaw r3, dp[pulse_ends]
    mkmsk r4, 1
    ldc r5, 0
    ldc r9, 0xFFF
    ldc r11, 12
    bt r10, .Lmodulated
.Leight:
    ldw r10, r0[0]
    # Pulse 0 of 8
    and r6, r10, r9
    ld8u r7, r2[r6]
    ld8u r8, r3[r6]
    lss r6, r8, r7
    ladd r6, r5, r5, r5, r6
    ldw r6, r1[r7]
    add r6, r6, r4
    stw r6, r1[r7]
    shr r10, r10, r11
    ldw r6, r1[r8]
    sub r6, r6, r4
    stw r6, r1[r8]
    shl r4, r4, 1
    # Pulse 1 of 8
    and r6, r10, r9
    ld8u r7, r2[r6]
    ld8u r8, r3[r6]
    lss r6, r8, r7
    ladd r6, r5, r5, r5, r6
    ldw r6, r1[r7]
    add r6, r6, r4
    stw r6, r1[r7]
    ldw r6, r1[r8]
    sub r6, r6, r4
    stw r6, r1[r8]
    shl r4, r4, 1
    # Pulse 2 of 8
    shr r6, r10, r11
    ldw r10, r0[1]
    shl r7, r10, 8
    or r6, r6, r7
    and r6, r6, r9
    ld8u r7, r2[r6]
    ld8u r8, r3[r6]
    lss r6, r8, r7
    ladd r6, r5, r5, r5, r6
    ldw r6, r1[r7]
    add r6, r6, r4
    stw r6, r1[r7]
    shr r10, r10, 4
    ldw r6, r1[r8]
    sub r6, r6, r4
    stw r6, r1[r8]
    shl r4, r4, 1
    # Pulse 3 of 8
    and r6, r10, r9
    ld8u r7, r2[r6]
    ld8u r8, r3[r6]
    lss r6, r8, r7
    ladd r6, r5, r5, r5, r6
    ldw r6, r1[r7]
    add r6, r6, r4
    stw r6, r1[r7]
    shr r10, r10, r11
    ldw r6, r1[r8]
    sub r6, r6, r4
    stw r6, r1[r8]
    shl r4, r4, 1
    # Pulse 4 of 8
    and r6, r10, r9
    ld8u r7, r2[r6]
    ld8u r8, r3[r6]
    lss r6, r8, r7
    ladd r6, r5, r5, r5, r6
    ldw r6, r1[r7]
    add r6, r6, r4
    stw r6, r1[r7]
    ldw r6, r1[r8]
    sub r6, r6, r4
    stw r6, r1[r8]
    shl r4, r4, 1
    # Pulse 5 of 8
    shr r6, r10, r11
    ldw r10, r0[2]
    shl r7, r10, 4
    or r6, r6, r7
    and r6, r6, r9
    ld8u r7, r2[r6]
    ld8u r8, r3[r6]
    lss r6, r8, r7
    ladd r6, r5, r5, r5, r6
    ldw r6, r1[r7]
    add r6, r6, r4
    stw r6, r1[r7]
    shr r10, r10, 8
    ldw r6, r1[r8]
    sub r6, r6, r4
    stw r6, r1[r8]
    shl r4, r4, 1
    # Pulse 6 of 8
    and r6, r10, r9
    ld8u r7, r2[r6]
    ld8u r8, r3[r6]
    lss r6, r8, r7
    ladd r6, r5, r5, r5, r6
    ldw r6, r1[r7]
    add r6, r6, r4
    stw r6, r1[r7]
    ldw r6, r1[r8]
    sub r6, r6, r4
    stw r6, r1[r8]
    shl r4, r4, 1
    # Pulse 7 of 8
    shr r6, r10, r11
    ld8u r7, r2[r6]
    ld8u r8, r3[r6]
    lss r6, r8, r7
    ladd r6, r5, r5, r5, r6
    ldw r6, r1[r7]
    add r6, r6, r4
    stw r6, r1[r7]
    ldw r6, r1[r8]
    sub r6, r6, r4
    stw r6, r1[r8]
    shl r4, r4, 1
    ldaw r0, r0[3]
    bt r4, .Leight
    bu .Lwords
.Lmodulated:
    mov r0, r10
.Leight_modulated:
    ldw r10, sp[8]
    ldw r10, r10[0]
    # Pulse 0 of 8
    and r6, r10, r9
    shr r7, r6, 7
    ld8u r7, r0[r7]
    zext r6, 7
    shl r7, r7, 7
    add r6, r6, r7
    ld8u r7, r2[r6]
    ld8u r8, r3[r6]
    lss r6, r8, r7
    ladd r6, r5, r5, r5, r6
    ldw r6, r1[r7]
    add r6, r6, r4
    stw r6, r1[r7]
    shr r10, r10, r11
    ldw r6, r1[r8]
    sub r6, r6, r4
    stw r6, r1[r8]
    shl r4, r4, 1
    # Pulse 1 of 8
    and r6, r10, r9
    shr r7, r6, 7
    ld8u r7, r0[r7]
    zext r6, 7
    shl r7, r7, 7
    add r6, r6, r7
    ld8u r7, r2[r6]
    ld8u r8, r3[r6]
    lss r6, r8, r7
    ladd r6, r5, r5, r5, r6
    ldw r6, r1[r7]
    add r6, r6, r4
    stw r6, r1[r7]
    ldw r6, r1[r8]
    sub r6, r6, r4
    stw r6, r1[r8]
    shl r4, r4, 1
    # Pulse 2 of 8
    shr r6, r10, r11
    ldw r10, sp[8]
    ldw r10, r10[1]
    shl r7, r10, 8
    or r6, r6, r7
    and r6, r6, r9
    shr r7, r6, 7
    ld8u r7, r0[r7]
    zext r6, 7
    shl r7, r7, 7
    add r6, r6, r7
    ld8u r7, r2[r6]
    ld8u r8, r3[r6]
    lss r6, r8, r7
    ladd r6, r5, r5, r5, r6
    ldw r6, r1[r7]
    add r6, r6, r4
    stw r6, r1[r7]
    shr r10, r10, 4
    ldw r6, r1[r8]
    sub r6, r6, r4
    stw r6, r1[r8]
    shl r4, r4, 1
    # Pulse 3 of 8
    and r6, r10, r9
    shr r7, r6, 7
    ld8u r7, r0[r7]
    zext r6, 7
    shl r7, r7, 7
    add r6, r6, r7
    ld8u r7, r2[r6]
    ld8u r8, r3[r6]
    lss r6, r8, r7
    ladd r6, r5, r5, r5, r6
    ldw r6, r1[r7]
    add r6, r6, r4
    stw r6, r1[r7]
    shr r10, r10, r11
    ldw r6, r1[r8]
    sub r6, r6, r4
    stw r6, r1[r8]
    shl r4, r4, 1
    # Pulse 4 of 8
    and r6, r10, r9
    shr r7, r6, 7
    ld8u r7, r0[r7]
    zext r6, 7
    shl r7, r7, 7
    add r6, r6, r7
    ld8u r7, r2[r6]
    ld8u r8, r3[r6]
    lss r6, r8, r7
    ladd r6, r5, r5, r5, r6
    ldw r6, r1[r7]
    add r6, r6, r4
    stw r6, r1[r7]
    ldw r6, r1[r8]
    sub r6, r6, r4
    stw r6, r1[r8]
    shl r4, r4, 1
    # Pulse 5 of 8
    shr r6, r10, r11
    ldw r10, sp[8]
    ldw r10, r10[2]
    shl r7, r10, 4
    or r6, r6, r7
    and r6, r6, r9
    shr r7, r6, 7
    ld8u r7, r0[r7]
    zext r6, 7
    shl r7, r7, 7
    add r6, r6, r7
    ld8u r7, r2[r6]
    ld8u r8, r3[r6]
    lss r6, r8, r7
    ladd r6, r5, r5, r5, r6
    ldw r6, r1[r7]
    add r6, r6, r4
    stw r6, r1[r7]
    shr r10, r10, 8
    ldw r6, r1[r8]
    sub r6, r6, r4
    stw r6, r1[r8]
    shl r4, r4, 1
    # Pulse 6 of 8
    and r6, r10, r9
    shr r7, r6, 7
    ld8u r7, r0[r7]
    zext r6, 7
    shl r7, r7, 7
    add r6, r6, r7
    ld8u r7, r2[r6]
    ld8u r8, r3[r6]
    lss r6, r8, r7
    ladd r6, r5, r5, r5, r6
    ldw r6, r1[r7]
    add r6, r6, r4
    stw r6, r1[r7]
    ldw r6, r1[r8]
    sub r6, r6, r4
    stw r6, r1[r8]
    shl r4, r4, 1
    # Pulse 7 of 8
    shr r6, r10, r11
    shr r7, r6, 7
    ld8u r7, r0[r7]
    zext r6, 7
    shl r7, r7, 7
    add r6, r6, r7
    ld8u r7, r2[r6]
    ld8u r8, r3[r6]
    lss r6, r8, r7
    ladd r6, r5, r5, r5, r6
    ldw r6, r1[r7]
    add r6, r6, r4
    stw r6, r1[r7]
    ldw r6, r1[r8]
    sub r6, r6, r4
    stw r6, r1[r8]
    shl r4, r4, 1
    ldw r10, sp[8]
    ldaw r10, r10[3]
    stw r10, sp[8]
    bt r4, .Leight_modulated
.Lwords:
    bitrev r5, r5
    ldw r3, sp[9]
    # r4 is 0
    ldw r6, r1[0]
    add r5, r5, r6
    stw r5, r3[0]
    stw r4, r1[0]
    ldw r6, r1[1]
    add r5, r5, r6
    stw r5, r3[1]
    stw r4, r1[1]
    mov r0, r5
    ldw r4, sp[1]
    ldw r5, sp[2]
    ldw r6, sp[3]
    ldw r7, sp[4]
    ldw r8, sp[5]
    ldw r9, sp[6]
    ldw r10, sp[7]
    retsp 10
    .cc_bottom raster_begin.function

    .globl raster_end
    .p2align 2
    .type raster_end,@function
    .cc_top raster_end.function,raster_end
# r0 edges of the word after those that are made, r1 that word, r2 levels before it: 48 words more.
raster_end:
    entsp 4
    stw r4, sp[1]
    stw r5, sp[2]
    stw r6, sp[3]
    mov r5, r2
    mov r3, r1
    mov r1, r0
    ldc r2, 6
    ldc r4, 0
.Lsome:
    ldw r6, r1[0]
    add r5, r5, r6
    stw r5, r3[0]
    stw r4, r1[0]
    ldw r6, r1[1]
    add r5, r5, r6
    stw r5, r3[1]
    stw r4, r1[1]
    ldw r6, r1[2]
    add r5, r5, r6
    stw r5, r3[2]
    stw r4, r1[2]
    ldw r6, r1[3]
    add r5, r5, r6
    stw r5, r3[3]
    stw r4, r1[3]
    ldw r6, r1[4]
    add r5, r5, r6
    stw r5, r3[4]
    stw r4, r1[4]
    ldw r6, r1[5]
    add r5, r5, r6
    stw r5, r3[5]
    stw r4, r1[5]
    ldw r6, r1[6]
    add r5, r5, r6
    stw r5, r3[6]
    stw r4, r1[6]
    ldw r6, r1[7]
    add r5, r5, r6
    stw r5, r3[7]
    stw r4, r1[7]
    ldaw r1, r1[8]
    ldaw r3, r3[8]
    sub r2, r2, 1
    bt r2, .Lsome
    ldw r4, sp[1]
    ldw r5, sp[2]
    ldw r6, sp[3]
    retsp 4
    .cc_bottom raster_end.function

    .globl slice_copy
    .p2align 2
    .type slice_copy,@function
    .cc_top slice_copy.function,slice_copy
# r0 to, r1 from: 12 words.
slice_copy:
    ldw r2, r1[11]
    ldw r3, r1[10]
    ldaw r11, r0[11]
    stw r2, r11[0]
    stw r3, r0[10]
    ldw r2, r1[0]
    ldw r3, r1[1]
    stw r2, r0[0]
    stw r3, r0[1]
    ldw r2, r1[2]
    ldw r3, r1[3]
    stw r2, r0[2]
    stw r3, r0[3]
    ldw r2, r1[4]
    ldw r3, r1[5]
    stw r2, r0[4]
    stw r3, r0[5]
    ldw r2, r1[6]
    ldw r3, r1[7]
    stw r2, r0[6]
    stw r3, r0[7]
    ldw r2, r1[8]
    ldw r3, r1[9]
    stw r2, r0[8]
    stw r3, r0[9]
    retsp 0
    .cc_bottom slice_copy.function
