# From pulses to the words of a port (PUL-004, PUL-005, PUL-006).
#
# Two tables give the ticks in which each packed pulse begins and ends. What is no pulse begins and ends at tick 0. First
# each tick gets its edges: the bits that rise there less the bits that fall, as a number. Then each word is the one
# before it and these: at every tick a bit is 0 or 1, so that nothing is carried from one bit to the next. The first word
# needs the bits of the pulses that go round the end of the period: those that end before they begin.
#
# Addition is a short instruction and exclusive or is not, so that this way more of them are there when they are needed.

# A pulse that is packed in r6, under a row of widths if `modulated`: its level at tick 0, and the edge at which it begins.
    .macro RISE modulated
    .if \modulated
    shr r7, r6, 7
    ld8u r7, r0[r7]
    zext r6, 7
    shl r7, r7, 7
    add r6, r6, r7
    .endif
    ld8u r7, r2[r6]
    ld8u r8, r3[r6]
    lss r6, r8, r7
    ladd r6, r5, r5, r5, r6
    ldw r6, r1[r7]
    add r6, r6, r4
    stw r6, r1[r7]
    .endm

# The edge at which that pulse ends, and the next pulse's bit.
    .macro FALL
    ldw r6, r1[r8]
    sub r6, r6, r4
    stw r6, r1[r8]
    shl r4, r4, 1
    .endm

# A word of the slice. A row of widths is in r0, and then the slice's address is on the stack.
    .macro PACKED word, modulated
    .if \modulated
    ldw r10, sp[8]
    ldw r10, r10[\word]
    .else
    ldw r10, r0[\word]
    .endif
    .endm

# Eight pulses from three words. What takes a pulse's bits out of r10 stands between two instructions that use memory.
    .macro EIGHT modulated
    PACKED 0, \modulated
    # Pulse 0 of 8
    and r6, r10, r9
    RISE \modulated
    shr r10, r10, r11
    FALL
    # Pulse 1 of 8
    and r6, r10, r9
    RISE \modulated
    FALL
    # Pulse 2 of 8
    shr r6, r10, r11
    PACKED 1, \modulated
    shl r7, r10, 8
    or r6, r6, r7
    and r6, r6, r9
    RISE \modulated
    shr r10, r10, 4
    FALL
    # Pulse 3 of 8
    and r6, r10, r9
    RISE \modulated
    shr r10, r10, r11
    FALL
    # Pulse 4 of 8
    and r6, r10, r9
    RISE \modulated
    FALL
    # Pulse 5 of 8
    shr r6, r10, r11
    PACKED 2, \modulated
    shl r7, r10, 4
    or r6, r6, r7
    and r6, r6, r9
    RISE \modulated
    shr r10, r10, 8
    FALL
    # Pulse 6 of 8
    and r6, r10, r9
    RISE \modulated
    FALL
    # Pulse 7 of 8
    shr r6, r10, r11
    RISE \modulated
    FALL
    .endm

# A word of the port from the one before it, in r5, and the edges of its tick, which are cleared: r4 is 0.
    .macro WORD tick
    ldw r6, r1[\tick]
    add r5, r5, r6
    stw r5, r3[\tick]
    stw r4, r1[\tick]
    .endm

# Two words, at an even place.
    .macro COPY word
    ldw r2, r1[\word]
    ldw r3, r1[\word+1]
    stw r2, r0[\word]
    stw r3, r0[\word+1]
    .endm

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
    EIGHT 0
    ldaw r0, r0[3]
    bt r4, .Leight
    bu .Lwords
.Lmodulated:
    mov r0, r10
.Leight_modulated:
    EIGHT 1
    ldw r10, sp[8]
    ldaw r10, r10[3]
    stw r10, sp[8]
    bt r4, .Leight_modulated
.Lwords:
    bitrev r5, r5
    ldw r3, sp[9]
    # r4 is 0
    WORD 0
    WORD 1
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
    WORD 0
    WORD 1
    WORD 2
    WORD 3
    WORD 4
    WORD 5
    WORD 6
    WORD 7
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
    COPY 0
    COPY 2
    COPY 4
    COPY 6
    COPY 8
    retsp 0
    .cc_bottom slice_copy.function
