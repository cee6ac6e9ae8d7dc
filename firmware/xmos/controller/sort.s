// The two halves of sorting, each for a range of pulses, so that several threads share the work.
//
// scatter  takes pulses of 12 bits out of the block's payload, looks each up in a table of powers, and stores it as a
//          word at the place of its channel
// pack     makes pulses of 12 bits of these words again, in the order of channels
//
// Both read their range from the thread's task, which cp points to. They keep neither sp nor dp and have no stack:
// these registers walk along memory, because loads relative to them are short instructions with offsets up to 63.
// Loads and stores alternate with other instructions where they can, because only these fetch the next ones.
// A loop's body handles two pieces of 8 pulses; a thread with an odd number of them begins in its middle.
//
// A reserved pulse (PUL-001) has a power of -32768 in the table. The sum of 16 powers is then negative, because 15 of
// at most 1000 do not outweigh it.

	.globl scatter, pack
	.text

// Store the pulse in a register at its channel's place; its power goes into a register.
	.macro PUT pulse, place, power
	ldw r9, sp[\place]
	stw \pulse, r9[0]
	ld16s \power, r0[\pulse]
	.endm

// Eight pulses from three words. The power of the second, which comes first, begins the sum or is added to it.
	.macro EIGHT word, place, begins
	ldw r6, dp[\word]
	shr r8, r6, r3
	zext r8, r3
	.if \begins
	PUT r8, \place+1, r10
	.else
	PUT r8, \place+1, r9
	add r10, r10, r9
	.endif
	ldw r7, dp[\word+1]
	shr r9, r6, 24
	shl r8, r7, 8
	or r8, r8, r9
	zext r8, r3
	PUT r8, \place+2, r9
	zext r6, r3
	add r10, r10, r9
	PUT r6, \place, r9
	shr r8, r7, 4
	add r10, r10, r9
	zext r8, r3
	PUT r8, \place+3, r9
	shr r8, r7, 16
	add r10, r10, r9
	zext r8, r3
	PUT r8, \place+4, r9
	ldw r6, dp[\word+2]
	add r10, r10, r9
	shr r7, r7, r4
	shl r8, r6, 4
	or r8, r8, r7
	zext r8, r3
	PUT r8, \place+5, r9
	shr r8, r6, 8
	add r10, r10, r9
	zext r8, r3
	PUT r8, \place+6, r9
	shr r6, r6, r5
	add r10, r10, r9
	PUT r6, \place+7, r9
	add r10, r10, r9
	.endm

	.p2align 2
	.type scatter,@function
scatter:		// r0: powers, r1: total drive, r2: below 0 if a pulse is reserved, r3 to r5: 12, 28, 20,
			// r6 to r8: words and pulses, r9: places and powers, r10: the sum of 16 powers, r11: rounds left
	ldw r11, cp[0]
	ldc r1, 0
	ldc r2, 0
	bf r11, .Lscattered
	ldw r6, cp[1]
	set sp, r6
	ldw r6, cp[6]
	ldw r7, cp[2]
	ldw r6, r6[0]
	add r6, r6, r7
	set dp, r6
	ldw r0, cp[7]
	ldc r3, 12
	ldc r4, 28
	ldc r5, 20
	mov r10, r11
	add r11, r11, 1
	shr r11, r11, 1
	zext r10, 1
	bf r10, .Lround
	ldc r10, 0
	extsp 8
	extdp 3
	bu .Lodd
	.p2align 2
.Lround:
	EIGHT 0, 0, 1
.Lodd:
	EIGHT 3, 8, 0
	add r1, r1, r10
	or r2, r2, r10
	ldaw sp, sp[16]
	ldaw dp, dp[6]
	sub r11, r11, 1
	bt r11, .Lround
.Lscattered:
	ldw r6, cp[8]
	stw r1, r6[0]
	stw r2, r6[1]
	retsp 0
	.size scatter, .-scatter

// Three words from eight pulses a to h. Long multiplications by powers of two shift and add at once, and their upper
// halves are the bits that the next word begins with.
	.macro PACK_EIGHT place, word
	ldw r8, sp[\place+1]
	shl r8, r8, r3
	ldw r9, sp[\place]
	ldw r10, sp[\place+2]
	lmul r1, r2, r10, r4, r8, r9	// a + b 2^12 + c 2^24
	stw r2, dp[\word]
	ldw r8, sp[\place+3]
	shl r8, r8, 4
	ldw r9, sp[\place+5]
	ldw r10, sp[\place+4]
	lmul r0, r2, r9, r5, r1, r8	// c 2^-8 + d 2^4 + f 2^28
	maccu r0, r2, r10, r7		// + e 2^16
	ldw r8, sp[\place+6]
	stw r2, dp[\word+1]
	shl r8, r8, 8
	ldw r9, sp[\place+7]
	lmul r1, r2, r9, r6, r0, r8	// f 2^-4 + g 2^8 + h 2^20
	stw r2, dp[\word+2]
	.endm

	.p2align 2
	.type pack,@function
pack:			// r3: 12, r4 to r7: 2^24, 2^28, 2^20, 2^16, r0 to r2, r8 to r10: pulses and words, r11: rounds left
	ldw r11, cp[3]
	bf r11, .Lpacked
	ldw r0, cp[4]
	set sp, r0
	ldw r0, cp[6]
	ldw r1, cp[5]
	ldw r0, r0[1]
	add r0, r0, r1
	set dp, r0
	ldc r3, 12
	ldc r4, 1
	shl r7, r4, 16
	shl r6, r7, 4
	shl r4, r7, 8
	shl r5, r4, 4
	mov r10, r11
	add r11, r11, 1
	shr r11, r11, 1
	zext r10, 1
	bf r10, .Lslice
	extsp 8
	extdp 3
	bu .Lhalf
	.p2align 2
.Lslice:
	PACK_EIGHT 0, 0
.Lhalf:
	PACK_EIGHT 8, 3
	ldaw sp, sp[16]
	ldaw dp, dp[6]
	sub r11, r11, 1
	bt r11, .Lslice
.Lpacked:
	retsp 0
	.size pack, .-pack
