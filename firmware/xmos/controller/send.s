// Sends ten slices and then ten commits (CHN-003, CHN-004) as fast as the link takes them. The checksum of a commit
// (CHN-011) grows while its slice is sent, from the same words.

	.globl send
	.text

	.macro WORD at
	ldw r9, r2[\at]
	crc32 r10, r9, r5
	byterev r9, r9
	out res[r1], r9
	.endm

	.p2align 2
	.type send,@function
send:			// r0: channel end of jobs, r1: channel end of the link, r2: slices, r3: from node to node,
			// r4: checksums, r5: polynomial, r6: destination, r7 and r8: period, r9: words, r10: checksum, r11: end
	ldw r2, cp[0]
	ldw r7, r2[0]
	ldw r8, r2[1]
	ldw r5, cp[2]
	ldc r3, 1
	shl r3, r3, 16
.Ljob:
	ldw r4, cp[1]
	ldw r6, cp[3]
	ldw r11, cp[4]
	in r2, res[r0]
.Lslices:
	setd res[r1], r6
	ldw r9, r2[0]
	not r10, r9
	byterev r9, r9
	out res[r1], r9
	WORD 1
	WORD 2
	WORD 3
	WORD 4
	WORD 5
	WORD 6
	WORD 7
	WORD 8
	WORD 9
	WORD 10
	WORD 11
	outct res[r1], 1
	crc32 r10, r7, r5
	crc32 r10, r8, r5
	ldc r9, 0
	crc32 r10, r9, r5
	not r10, r10
	stw r10, r4[0]
	add r4, r4, 4
	ldc r9, 48
	add r2, r2, r9
	add r6, r6, r3
	eq r9, r6, r11
	bf r9, .Lslices
	ldw r4, cp[1]
	ldw r6, cp[5]
	ldw r11, cp[6]
	byterev r2, r7
	byterev r10, r8
.Lcommits:
	setd res[r1], r6
	out res[r1], r2
	out res[r1], r10
	ldw r9, r4[0]
	byterev r9, r9
	out res[r1], r9
	outct res[r1], 1
	add r4, r4, 4
	add r6, r6, r3
	eq r9, r6, r11
	bf r9, .Lcommits
sent:
	bu .Ljob
	.size send, .-send
