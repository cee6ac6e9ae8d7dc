# Made by clang from ack.c; do not edit.
# sha256 of it and what it includes: 05ae08dfae8bc2b9a955f678c6d4c995f79653c1dc3a272a2364f0e1c2cb92b5
	.text
	.globl	pw_ack_put
	.p2align	2
	.type	pw_ack_put,@function
	.cc_top pw_ack_put.function,pw_ack_put
pw_ack_put:
	entsp 3
	stw r4, sp[2]
	stw r5, sp[1]
	mov r4, r0
	ldc r0, 0
	ldc r2, 80
	st8 r2, r4[r0]
	mkmsk r2, 1
	ldc r3, 65
	st8 r3, r4[r2]
	ldc r3, 2
	st8 r2, r4[r3]
	ld8u r2, r1[r0]
	mkmsk r3, 2
	st8 r2, r4[r3]
	ldw r2, r1[1]
	ldc r3, 4
	st8 r2, r4[r3]
	shr r3, r2, 8
	ldc r11, 5
	st8 r3, r4[r11]
	shr r3, r2, 16
	ldc r11, 6
	st8 r3, r4[r11]
	shr r2, r2, 24
	mkmsk r3, 3
	st8 r2, r4[r3]
	ldw r2, r1[3]
	ldw r3, r1[2]
	ldc r11, 8
	st8 r3, r4[r11]
	shr r11, r3, 8
	ldc r5, 9
	st8 r11, r4[r5]
	shr r11, r3, 16
	ldc r5, 10
	st8 r11, r4[r5]
	shr r3, r3, 24
	ldc r11, 11
	st8 r3, r4[r11]
	ldc r3, 12
	st8 r2, r4[r3]
	shr r3, r2, 8
	ldc r11, 13
	st8 r3, r4[r11]
	shr r3, r2, 16
	ldc r11, 14
	st8 r3, r4[r11]
	shr r2, r2, 24
	mkmsk r3, 4
	st8 r2, r4[r3]
	ldw r2, r1[5]
	ldw r3, r1[4]
	ldc r11, 16
	st8 r3, r4[r11]
	shr r11, r3, 8
	ldc r5, 17
	st8 r11, r4[r5]
	shr r11, r3, 16
	ldc r5, 18
	st8 r11, r4[r5]
	shr r3, r3, 24
	ldc r11, 19
	st8 r3, r4[r11]
	ldc r3, 20
	st8 r2, r4[r3]
	shr r3, r2, 8
	ldc r11, 21
	st8 r3, r4[r11]
	shr r3, r2, 16
	ldc r11, 22
	st8 r3, r4[r11]
	shr r2, r2, 24
	ldc r3, 23
	st8 r2, r4[r3]
	ldc r2, 24
	ld8u r3, r1[r2]
	st8 r3, r4[r2]
	ldc r2, 25
	ld8u r3, r1[r2]
	st8 r3, r4[r2]
	ldc r2, 26
	ld8u r1, r1[r2]
	st8 r1, r4[r2]
	ldc r1, 27
	st8 r0, r4[r1]
	ldc r5, 28
	mov r1, r4
	mov r2, r5
	bl pw_crc32
	st8 r0, r4[r5]
	shr r1, r0, 8
	ldc r2, 29
	st8 r1, r4[r2]
	shr r1, r0, 16
	ldc r2, 30
	st8 r1, r4[r2]
	shr r0, r0, 24
	mkmsk r1, 5
	st8 r0, r4[r1]
	ldw r5, sp[1]
	ldw r4, sp[2]
	retsp 3
	.cc_bottom pw_ack_put.function
.Lfunc_end0:
	.size	pw_ack_put, .Lfunc_end0-pw_ack_put

	.globl	pw_status_put
	.p2align	2
	.type	pw_status_put,@function
	.cc_top pw_status_put.function,pw_status_put
pw_status_put:
	entsp 3
	stw r4, sp[2]
	stw r5, sp[1]
	mov r4, r0
	ldc r0, 0
	ldc r2, 80
	st8 r2, r4[r0]
	mkmsk r2, 1
	ldc r3, 83
	st8 r3, r4[r2]
	ldc r3, 2
	st8 r2, r4[r3]
	ld8u r2, r1[r0]
	mkmsk r3, 2
	st8 r2, r4[r3]
	add r2, r1, 2
	ld16s r2, r2[r0]
	ldc r3, 4
	st8 r2, r4[r3]
	shr r2, r2, 8
	ldc r11, 5
	st8 r2, r4[r11]
	ld8u r2, r1[r3]
	ldc r3, 6
	st8 r2, r4[r3]
	ld8u r2, r1[r11]
	mkmsk r3, 3
	st8 r2, r4[r3]
	ldw r2, r1[3]
	ldw r3, r1[2]
	ldc r11, 8
	st8 r3, r4[r11]
	shr r11, r3, 8
	ldc r5, 9
	st8 r11, r4[r5]
	shr r11, r3, 16
	ldc r5, 10
	st8 r11, r4[r5]
	shr r3, r3, 24
	ldc r11, 11
	st8 r3, r4[r11]
	ldc r3, 12
	st8 r2, r4[r3]
	shr r3, r2, 8
	ldc r11, 13
	st8 r3, r4[r11]
	shr r3, r2, 16
	ldc r11, 14
	st8 r3, r4[r11]
	shr r2, r2, 24
	mkmsk r3, 4
	st8 r2, r4[r3]
	ldw r2, r1[5]
	ldw r3, r1[4]
	ldc r11, 16
	st8 r3, r4[r11]
	shr r11, r3, 8
	ldc r5, 17
	st8 r11, r4[r5]
	shr r11, r3, 16
	ldc r5, 18
	st8 r11, r4[r5]
	shr r3, r3, 24
	ldc r11, 19
	st8 r3, r4[r11]
	ldc r3, 20
	st8 r2, r4[r3]
	shr r3, r2, 8
	ldc r11, 21
	st8 r3, r4[r11]
	shr r3, r2, 16
	ldc r11, 22
	st8 r3, r4[r11]
	shr r2, r2, 24
	ldc r3, 23
	st8 r2, r4[r3]
	ldw r2, r1[6]
	ldc r3, 24
	st8 r2, r4[r3]
	shr r3, r2, 8
	ldc r11, 25
	st8 r3, r4[r11]
	shr r3, r2, 16
	ldc r11, 26
	st8 r3, r4[r11]
	shr r2, r2, 24
	ldc r3, 27
	st8 r2, r4[r3]
	ldw r2, r1[7]
	ldc r3, 28
	st8 r2, r4[r3]
	shr r3, r2, 8
	ldc r11, 29
	st8 r3, r4[r11]
	shr r3, r2, 16
	ldc r11, 30
	st8 r3, r4[r11]
	shr r2, r2, 24
	mkmsk r3, 5
	st8 r2, r4[r3]
	ldw r2, r1[8]
	ldc r3, 32
	st8 r2, r4[r3]
	shr r3, r2, 8
	ldc r11, 33
	st8 r3, r4[r11]
	shr r3, r2, 16
	ldc r11, 34
	st8 r3, r4[r11]
	shr r2, r2, 24
	ldc r3, 35
	st8 r2, r4[r3]
	ldw r2, r1[9]
	ldc r3, 36
	st8 r2, r4[r3]
	shr r3, r2, 8
	ldc r11, 37
	st8 r3, r4[r11]
	shr r3, r2, 16
	ldc r11, 38
	st8 r3, r4[r11]
	shr r2, r2, 24
	ldc r3, 39
	st8 r2, r4[r3]
	ldw r2, r1[10]
	ldc r3, 40
	st8 r2, r4[r3]
	shr r3, r2, 8
	ldc r11, 41
	st8 r3, r4[r11]
	shr r3, r2, 16
	ldc r11, 42
	st8 r3, r4[r11]
	shr r2, r2, 24
	ldc r3, 43
	st8 r2, r4[r3]
	ldw r2, r1[11]
	ldc r3, 44
	st8 r2, r4[r3]
	shr r3, r2, 8
	ldc r11, 45
	st8 r3, r4[r11]
	shr r3, r2, 16
	ldc r11, 46
	st8 r3, r4[r11]
	shr r2, r2, 24
	ldc r3, 47
	st8 r2, r4[r3]
	ldc r2, 48
	ld8u r3, r1[r2]
	st8 r3, r4[r2]
	ldc r2, 49
	ld8u r3, r1[r2]
	st8 r3, r4[r2]
	ldc r2, 50
	add r3, r1, r2
	ld16s r3, r3[r0]
	st8 r3, r4[r2]
	shr r2, r3, 8
	ldc r3, 51
	st8 r2, r4[r3]
	ldc r2, 52
	add r3, r1, r2
	ld16s r3, r3[r0]
	st8 r3, r4[r2]
	shr r2, r3, 8
	ldc r3, 53
	st8 r2, r4[r3]
	ldc r2, 56
	add r1, r1, r2
	ldw r1, r1[0]
	ldc r3, 54
	st8 r1, r4[r3]
	shr r3, r1, 8
	ldc r11, 55
	st8 r3, r4[r11]
	shr r3, r1, 16
	st8 r3, r4[r2]
	shr r1, r1, 24
	ldc r2, 57
	st8 r1, r4[r2]
	ldc r1, 58
	st8 r0, r4[r1]
	ldc r1, 59
	st8 r0, r4[r1]
	ldc r5, 60
	mov r1, r4
	mov r2, r5
	bl pw_crc32
	st8 r0, r4[r5]
	shr r1, r0, 8
	ldc r2, 61
	st8 r1, r4[r2]
	shr r1, r0, 16
	ldc r2, 62
	st8 r1, r4[r2]
	shr r0, r0, 24
	mkmsk r1, 6
	st8 r0, r4[r1]
	ldw r5, sp[1]
	ldw r4, sp[2]
	retsp 3
	.cc_bottom pw_status_put.function
.Lfunc_end1:
	.size	pw_status_put, .Lfunc_end1-pw_status_put

	.ident	"Debian clang version 14.0.6"
	.section	".note.GNU-stack","",@progbits
