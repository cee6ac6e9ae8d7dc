// The CRC-32 of a block (BLK-003), by the processor's own instruction, which takes a word at a time. It wants the first
// word complemented in place of the initial value, and a word of zeros after the last.

	.globl block_crc
	.text

	.macro NEXT at
	ldw r3, dp[\at]
	crc32 r0, r3, r1
	.endm
	.macro SIX at
	NEXT \at
	NEXT \at+1
	NEXT \at+2
	NEXT \at+3
	NEXT \at+4
	NEXT \at+5
	.endm

	.p2align 2
	.type block_crc,@function
block_crc:		// r0: a block, in words; returns the checksum. Keeps neither dp nor r1 to r3 and r11; no stack.
	set dp, r0
	ldw r1, cp[9]
	ldc r2, 0
	ldw r3, dp[0]
	not r0, r3
	SIX 1
	crc32 r0, r2, r1	// the checksum itself counts as 0
	ldc r11, 5
.Lwords:
	SIX 8
	SIX 14
	SIX 20
	SIX 26
	ldaw dp, dp[24]
	sub r11, r11, 1
	bt r11, .Lwords
	crc32 r0, r2, r1
	not r0, r0
	retsp 0
	.size block_crc, .-block_crc
