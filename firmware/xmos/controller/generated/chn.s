# Made by clang from chn.c; do not edit.
# sha256 of it and what it includes: cc2cb46c487ba8e9b460d481a72bfe75dc18e197bebc7f04f4938415f343b82b
	.text
	.globl	pw_slice_put
	.p2align	2
	.type	pw_slice_put,@function
	.cc_top pw_slice_put.function,pw_slice_put
pw_slice_put:
	entsp 1
	mov r3, r2
	shr r2, r1, 8
	ldc r11, 0
	st8 r2, r0[r11]
	mkmsk r2, 1
	st8 r1, r0[r2]
	ldc r1, 2
	st8 r2, r0[r1]
	add r0, r0, 3
	ldc r2, 48
	mov r1, r3
	bl memcpy
	ldc r0, 51
	retsp 1
	.cc_bottom pw_slice_put.function
.Lfunc_end0:
	.size	pw_slice_put, .Lfunc_end0-pw_slice_put

	.globl	pw_commit_checksum
	.p2align	2
	.type	pw_commit_checksum,@function
	.cc_top pw_commit_checksum.function,pw_commit_checksum
pw_commit_checksum:
	entsp 3
	mov r3, r0
	stw r2, sp[2]
	stw r1, sp[1]
	ldc r0, 0
	ldc r2, 48
	mov r1, r3
	bl pw_crc32
	ldaw r1, sp[1]
	ldc r2, 8
	bl pw_crc32
	retsp 3
	.cc_bottom pw_commit_checksum.function
.Lfunc_end1:
	.size	pw_commit_checksum, .Lfunc_end1-pw_commit_checksum

	.globl	pw_commit_put
	.p2align	2
	.type	pw_commit_put,@function
	.cc_top pw_commit_put.function,pw_commit_put
pw_commit_put:
	extsp 3
	stw r4, sp[2]
	stw r5, sp[1]
	stw r6, sp[0]
	ldw r11, sp[4]
	shr r4, r1, 8
	ldc r5, 0
	st8 r4, r0[r5]
	mkmsk r4, 1
	st8 r1, r0[r4]
	ldc r1, 2
	st8 r1, r0[r1]
	mkmsk r1, 2
	st8 r2, r0[r1]
	shr r1, r3, 8
	shr r4, r2, 8
	ldc r5, 4
	st8 r4, r0[r5]
	shr r4, r3, 16
	shr r5, r2, 16
	ldc r6, 5
	st8 r5, r0[r6]
	shr r5, r3, 24
	shr r2, r2, 24
	ldc r6, 6
	st8 r2, r0[r6]
	mkmsk r2, 3
	st8 r3, r0[r2]
	ldc r2, 8
	st8 r1, r0[r2]
	ldc r1, 9
	st8 r4, r0[r1]
	ldc r1, 10
	st8 r5, r0[r1]
	ldc r1, 11
	st8 r11, r0[r1]
	shr r1, r11, 8
	ldc r2, 12
	st8 r1, r0[r2]
	shr r1, r11, 16
	ldc r2, 13
	st8 r1, r0[r2]
	shr r1, r11, 24
	ldc r2, 14
	st8 r1, r0[r2]
	mkmsk r0, 4
	ldw r6, sp[0]
	ldw r5, sp[1]
	ldw r4, sp[2]
	ldaw sp, sp[3]
	retsp 0
	.cc_bottom pw_commit_put.function
.Lfunc_end2:
	.size	pw_commit_put, .Lfunc_end2-pw_commit_put

	.globl	pw_commit_get
	.p2align	2
	.type	pw_commit_get,@function
	.cc_top pw_commit_get.function,pw_commit_get
pw_commit_get:
	extsp 4
	stw r4, sp[3]
	stw r5, sp[2]
	stw r6, sp[1]
	stw r7, sp[0]
	mov r11, r0
	ldc r0, 12
	eq r0, r3, r0
	bf r0, .LBB3_2
	ldc r3, 0
	ld8u r3, r2[r3]
	mkmsk r4, 1
	ld8u r4, r2[r4]
	shl r4, r4, 8
	ldc r5, 2
	ld8u r5, r2[r5]
	mkmsk r6, 2
	ld8u r6, r2[r6]
	shl r6, r6, 24
	shl r5, r5, 16
	or r3, r4, r3
	or r3, r3, r5
	or r3, r3, r6
	ldc r4, 4
	ld8u r4, r2[r4]
	ldc r5, 5
	ld8u r5, r2[r5]
	shl r5, r5, 8
	ldc r6, 6
	ld8u r6, r2[r6]
	mkmsk r7, 3
	ld8u r7, r2[r7]
	shl r7, r7, 24
	shl r6, r6, 16
	or r4, r5, r4
	or r4, r4, r6
	or r4, r4, r7
	stw r4, r11[1]
	stw r3, r11[0]
	ldc r3, 8
	ld8u r3, r2[r3]
	ldc r11, 9
	ld8u r11, r2[r11]
	shl r11, r11, 8
	ldc r4, 10
	ld8u r4, r2[r4]
	ldc r5, 11
	ld8u r2, r2[r5]
	shl r2, r2, 24
	shl r4, r4, 16
	or r3, r11, r3
	or r3, r3, r4
	or r2, r3, r2
	stw r2, r1[0]
.LBB3_2:
	ldw r7, sp[0]
	ldw r6, sp[1]
	ldw r5, sp[2]
	ldw r4, sp[3]
	ldaw sp, sp[4]
	retsp 0
	.cc_bottom pw_commit_get.function
.Lfunc_end3:
	.size	pw_commit_get, .Lfunc_end3-pw_commit_get

	.globl	pw_load_put
	.p2align	2
	.type	pw_load_put,@function
	.cc_top pw_load_put.function,pw_load_put
pw_load_put:
	entsp 4
	stw r4, sp[3]
	stw r5, sp[2]
	stw r6, sp[1]
	mov r4, r0
	shr r0, r1, 8
	ldc r5, 0
	st8 r0, r4[r5]
	mkmsk r0, 1
	st8 r1, r4[r0]
	ldc r0, 2
	mkmsk r1, 2
	st8 r1, r4[r0]
	ld8u r0, r2[r5]
	st8 r0, r4[r1]
	add r0, r2, 2
	ld16s r0, r0[r5]
	ldc r1, 4
	st8 r0, r4[r1]
	shr r0, r0, 8
	ldc r3, 5
	st8 r0, r4[r3]
	ld8u r0, r2[r1]
	ldc r1, 6
	st8 r0, r4[r1]
	add r0, r4, 7
	add r1, r2, 5
	ldc r2, 48
	bl memcpy
	ldc r6, 55
	mov r0, r5
	mov r1, r4
	mov r2, r6
	bl pw_crc32
	st8 r0, r4[r6]
	shr r1, r0, 8
	ldc r2, 56
	st8 r1, r4[r2]
	shr r1, r0, 16
	ldc r2, 57
	st8 r1, r4[r2]
	shr r0, r0, 24
	ldc r1, 58
	st8 r0, r4[r1]
	ldc r0, 59
	ldw r6, sp[1]
	ldw r5, sp[2]
	ldw r4, sp[3]
	retsp 4
	.cc_bottom pw_load_put.function
.Lfunc_end4:
	.size	pw_load_put, .Lfunc_end4-pw_load_put

	.globl	pw_load_get
	.p2align	2
	.type	pw_load_get,@function
	.cc_top pw_load_get.function,pw_load_get
pw_load_get:
	entsp 9
	stw r4, sp[8]
	stw r5, sp[7]
	stw r6, sp[6]
	stw r7, sp[5]
	stw r8, sp[4]
	stw r9, sp[3]
	stw r10, sp[2]
	mov r5, r2
	mov r2, r1
	mov r6, r0
	ldc r0, 9
	lsu r0, r0, r2
	ldc r4, 0
	bt r0, .LBB5_12
	ldc r0, 56
	eq r0, r3, r0
	bf r0, .LBB5_12
	shr r0, r2, 8
	ldc r4, 0
	ldaw r1, sp[1]
	st8 r0, r1[r4]
	mkmsk r0, 1
	or r0, r1, r0
	st8 r2, r0[r4]
	ldc r10, 2
	or r0, r1, r10
	mkmsk r7, 2
	st8 r7, r0[r4]
	ldc r8, 52
	ld8u r0, r5[r8]
	ldc r2, 53
	ld8u r2, r5[r2]
	shl r2, r2, 8
	ldc r3, 54
	ld8u r3, r5[r3]
	ldc r11, 55
	ld8u r11, r5[r11]
	shl r11, r11, 24
	shl r3, r3, 16
	or r0, r2, r0
	or r0, r0, r3
	or r9, r0, r11
	mov r0, r4
	mov r2, r7
	bl pw_crc32
	mov r1, r5
	mov r2, r8
	bl pw_crc32
	eq r0, r9, r0
	bf r0, .LBB5_12
	ldc r4, 0
	ld8u r8, r5[r4]
	st8 r8, r6[r4]
	mkmsk r0, 1
	ld8u r0, r5[r0]
	ld8u r1, r5[r10]
	shl r1, r1, 8
	or r9, r1, r0
	add r0, r6, 2
	st16 r9, r0[r4]
	ld8u r7, r5[r7]
	ldc r10, 4
	st8 r7, r6[r10]
	add r6, r6, 5
	add r1, r5, 4
	ldc r5, 48
	mov r0, r6
	mov r2, r5
	bl memcpy
	lsu r0, r8, r10
	bt r0, .LBB5_5
	mov r8, r4
.LBB5_5:
	ldaw r11, cp[memories]
	bf r7, .LBB5_12
	ldaw r0, r11[r8]
	ldc r1, 2
	ld8u r0, r0[r1]
	mul r0, r0, r7
	lsu r1, r5, r0
	mkmsk r3, 1
	bt r1, .LBB5_12
	zext r9, 16
	add r1, r9, r7
	ldaw r11, cp[memories]
	ldaw r2, r11[r8]
	ldc r4, 0
	ld16s r2, r2[r4]
	zext r2, 16
	lsu r1, r2, r1
	bt r1, .LBB5_12
	eq r1, r0, r5
	mov r4, r3
	bt r1, .LBB5_12
	ldc r1, 0
.LBB5_10:
	ld8u r2, r6[r0]
	or r1, r1, r2
	add r0, r0, 1
	eq r2, r0, r5
	bf r2, .LBB5_10
	eq r4, r1, 0
.LBB5_12:
	mov r0, r4
	ldw r10, sp[2]
	ldw r9, sp[3]
	ldw r8, sp[4]
	ldw r7, sp[5]
	ldw r6, sp[6]
	ldw r5, sp[7]
	ldw r4, sp[8]
	retsp 9
	.cc_bottom pw_load_get.function
.Lfunc_end5:
	.size	pw_load_get, .Lfunc_end5-pw_load_get

	.globl	pw_program_put
	.p2align	2
	.type	pw_program_put,@function
	.cc_top pw_program_put.function,pw_program_put
pw_program_put:
	entsp 3
	stw r4, sp[2]
	stw r5, sp[1]
	mov r4, r0
	shr r3, r1, 8
	ldc r0, 0
	st8 r3, r4[r0]
	mkmsk r3, 1
	st8 r1, r4[r3]
	ldc r1, 2
	ldc r3, 4
	st8 r3, r4[r1]
	ld8u r1, r2[r0]
	mkmsk r11, 2
	st8 r1, r4[r11]
	add r1, r2, 2
	ld16s r1, r1[r0]
	st8 r1, r4[r3]
	shr r1, r1, 8
	ldc r3, 5
	st8 r1, r4[r3]
	add r1, r2, 4
	ld16s r1, r1[r0]
	ldc r3, 6
	st8 r1, r4[r3]
	shr r1, r1, 8
	mkmsk r3, 3
	st8 r1, r4[r3]
	add r1, r2, 6
	ld16s r1, r1[r0]
	ldc r3, 8
	st8 r1, r4[r3]
	shr r1, r1, 8
	ldc r3, 9
	st8 r1, r4[r3]
	add r1, r2, 8
	ld16s r1, r1[r0]
	ldc r3, 10
	st8 r1, r4[r3]
	shr r1, r1, 8
	ldc r3, 11
	st8 r1, r4[r3]
	ldw r1, r2[4]
	ldw r2, r2[3]
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
	ldc r2, 16
	st8 r1, r4[r2]
	shr r2, r1, 8
	ldc r3, 17
	st8 r2, r4[r3]
	shr r2, r1, 16
	ldc r3, 18
	st8 r2, r4[r3]
	shr r1, r1, 24
	ldc r2, 19
	st8 r1, r4[r2]
	ldc r5, 20
	mov r1, r4
	mov r2, r5
	bl pw_crc32
	st8 r0, r4[r5]
	shr r1, r0, 8
	ldc r2, 21
	st8 r1, r4[r2]
	shr r1, r0, 16
	ldc r2, 22
	st8 r1, r4[r2]
	shr r0, r0, 24
	ldc r1, 23
	st8 r0, r4[r1]
	ldc r0, 24
	ldw r5, sp[1]
	ldw r4, sp[2]
	retsp 3
	.cc_bottom pw_program_put.function
.Lfunc_end6:
	.size	pw_program_put, .Lfunc_end6-pw_program_put

	.globl	pw_program_get
	.p2align	2
	.type	pw_program_get,@function
	.cc_top pw_program_get.function,pw_program_get
pw_program_get:
	entsp 9
	stw r4, sp[8]
	stw r5, sp[7]
	stw r6, sp[6]
	stw r7, sp[5]
	stw r8, sp[4]
	stw r9, sp[3]
	stw r10, sp[2]
	mov r5, r2
	mov r2, r1
	mov r4, r0
	ldc r9, 9
	lsu r0, r9, r2
	ldc r6, 0
	bt r0, .LBB7_9
	ldc r0, 21
	eq r0, r3, r0
	bf r0, .LBB7_9
	shr r0, r2, 8
	ldc r6, 0
	ldaw r1, sp[1]
	st8 r0, r1[r6]
	mkmsk r0, 1
	or r0, r1, r0
	st8 r2, r0[r6]
	ldc r0, 2
	or r0, r1, r0
	ldc r2, 4
	st8 r2, r0[r6]
	ldc r8, 17
	ld8u r0, r5[r8]
	ldc r2, 18
	ld8u r2, r5[r2]
	shl r2, r2, 8
	ldc r3, 19
	ld8u r3, r5[r3]
	ldc r11, 20
	ld8u r11, r5[r11]
	shl r11, r11, 24
	shl r3, r3, 16
	or r0, r2, r0
	or r0, r0, r3
	or r10, r0, r11
	mkmsk r7, 2
	mov r0, r6
	mov r2, r7
	bl pw_crc32
	mov r1, r5
	mov r2, r8
	bl pw_crc32
	eq r0, r10, r0
	bf r0, .LBB7_9
	ldc r6, 0
	ld8u r1, r5[r6]
	st8 r1, r4[r6]
	mkmsk r0, 1
	ld8u r0, r5[r0]
	ldc r2, 2
	ld8u r2, r5[r2]
	shl r2, r2, 8
	or r3, r2, r0
	add r0, r4, 2
	st16 r3, r0[r6]
	ld8u r0, r5[r7]
	ldc r2, 4
	ld8u r2, r5[r2]
	shl r2, r2, 8
	or r11, r2, r0
	add r0, r4, 4
	st16 r11, r0[r6]
	ldc r0, 5
	ld8u r0, r5[r0]
	ldc r2, 6
	ld8u r2, r5[r2]
	shl r2, r2, 8
	or r0, r2, r0
	add r2, r4, 6
	st16 r0, r2[r6]
	mkmsk r2, 3
	ld8u r2, r5[r2]
	ldc r7, 8
	ld8u r7, r5[r7]
	shl r7, r7, 8
	or r2, r7, r2
	add r7, r4, 8
	st16 r2, r7[r6]
	ld8u r6, r5[r9]
	ldc r7, 10
	ld8u r7, r5[r7]
	shl r7, r7, 8
	ldc r8, 11
	ld8u r8, r5[r8]
	ldc r9, 12
	ld8u r9, r5[r9]
	shl r9, r9, 24
	shl r8, r8, 16
	or r6, r7, r6
	or r6, r6, r8
	or r6, r6, r9
	ldc r7, 13
	ld8u r7, r5[r7]
	ldc r8, 14
	ld8u r8, r5[r8]
	shl r8, r8, 8
	mkmsk r9, 4
	ld8u r9, r5[r9]
	ldc r10, 16
	ld8u r5, r5[r10]
	shl r5, r5, 24
	shl r9, r9, 16
	or r7, r8, r7
	or r7, r7, r9
	or r5, r7, r5
	stw r5, r4[4]
	stw r6, r4[3]
	zext r3, 16
	zext r11, 16
	ldc r4, 254
	and r4, r1, r4
	bf r11, .LBB7_4
	add r3, r11, r3
	eq r1, r1, 2
	bf r1, .LBB7_7
	ldc r1, 1025
	lsu r1, r3, r1
	zext r0, 16
	eq r0, r0, 0
	and r6, r1, r0
	bu .LBB7_9
.LBB7_4:
	eq r1, r4, 2
	eq r3, r3, 0
	and r1, r1, r3
	zext r0, 16
	eq r0, r0, 0
	bu .LBB7_8
.LBB7_7:
	eq r1, r4, 2
	ldc r11, 4097
	lsu r3, r3, r11
	zext r0, 16
	eq r0, r0, 0
	eq r0, r0, 0
	and r1, r1, r3
.LBB7_8:
	and r0, r1, r0
	zext r2, 16
	eq r1, r2, 0
	and r6, r0, r1
.LBB7_9:
	mov r0, r6
	ldw r10, sp[2]
	ldw r9, sp[3]
	ldw r8, sp[4]
	ldw r7, sp[5]
	ldw r6, sp[6]
	ldw r5, sp[7]
	ldw r4, sp[8]
	retsp 9
	.cc_bottom pw_program_get.function
.Lfunc_end7:
	.size	pw_program_get, .Lfunc_end7-pw_program_get

	.globl	pw_collect_put
	.p2align	2
	.type	pw_collect_put,@function
	.cc_top pw_collect_put.function,pw_collect_put
pw_collect_put:
	entsp 4
	stw r4, sp[3]
	stw r5, sp[2]
	stw r6, sp[1]
	mov r4, r0
	shr r3, r1, 8
	ldc r0, 0
	st8 r3, r4[r0]
	mkmsk r3, 1
	st8 r1, r4[r3]
	ldc r1, 2
	ldc r6, 5
	st8 r6, r4[r1]
	mkmsk r1, 2
	st8 r2, r4[r1]
	ldc r5, 4
	mov r1, r4
	mov r2, r5
	bl pw_crc32
	st8 r0, r4[r5]
	shr r1, r0, 8
	st8 r1, r4[r6]
	shr r1, r0, 16
	ldc r2, 6
	st8 r1, r4[r2]
	shr r0, r0, 24
	mkmsk r1, 3
	st8 r0, r4[r1]
	ldc r0, 8
	ldw r6, sp[1]
	ldw r5, sp[2]
	ldw r4, sp[3]
	retsp 4
	.cc_bottom pw_collect_put.function
.Lfunc_end8:
	.size	pw_collect_put, .Lfunc_end8-pw_collect_put

	.globl	pw_collect_get
	.p2align	2
	.type	pw_collect_get,@function
	.cc_top pw_collect_get.function,pw_collect_get
pw_collect_get:
	entsp 8
	stw r4, sp[7]
	stw r5, sp[6]
	stw r6, sp[5]
	stw r7, sp[4]
	stw r8, sp[3]
	stw r9, sp[2]
	mov r4, r2
	mov r5, r0
	ldc r0, 9
	lsu r0, r0, r1
	ldc r6, 0
	bt r0, .LBB9_4
	eq r0, r3, 5
	bf r0, .LBB9_4
	shr r0, r1, 8
	ldc r6, 0
	ldaw r3, sp[1]
	st8 r0, r3[r6]
	mkmsk r7, 1
	or r0, r3, r7
	st8 r1, r0[r6]
	ldc r8, 2
	or r0, r3, r8
	ldc r1, 5
	st8 r1, r0[r6]
	ld8u r0, r4[r7]
	ld8u r1, r4[r8]
	shl r1, r1, 8
	mkmsk r2, 2
	ld8u r11, r4[r2]
	ldc r9, 4
	ld8u r9, r4[r9]
	shl r9, r9, 24
	shl r11, r11, 16
	or r0, r1, r0
	or r0, r0, r11
	or r9, r0, r9
	mov r0, r6
	mov r1, r3
	bl pw_crc32
	mov r1, r4
	mov r2, r7
	bl pw_crc32
	eq r0, r9, r0
	bf r0, .LBB9_4
	ldc r0, 0
	ld8u r1, r4[r0]
	st8 r1, r5[r0]
	sub r0, r1, 7
	zext r0, 8
	lsu r6, r0, r8
.LBB9_4:
	mov r0, r6
	ldw r9, sp[2]
	ldw r8, sp[3]
	ldw r7, sp[4]
	ldw r6, sp[5]
	ldw r5, sp[6]
	ldw r4, sp[7]
	retsp 8
	.cc_bottom pw_collect_get.function
.Lfunc_end9:
	.size	pw_collect_get, .Lfunc_end9-pw_collect_get

	.globl	pw_number_put
	.p2align	2
	.type	pw_number_put,@function
	.cc_top pw_number_put.function,pw_number_put
pw_number_put:
	entsp 4
	stw r4, sp[3]
	stw r5, sp[2]
	stw r6, sp[1]
	mov r4, r0
	ldc r0, 0
	mkmsk r2, 8
	st8 r2, r4[r0]
	mkmsk r3, 1
	st8 r2, r4[r3]
	ldc r2, 2
	ldc r6, 6
	st8 r6, r4[r2]
	mkmsk r2, 2
	st8 r1, r4[r2]
	ldc r5, 4
	mov r1, r4
	mov r2, r5
	bl pw_crc32
	st8 r0, r4[r5]
	shr r1, r0, 8
	ldc r2, 5
	st8 r1, r4[r2]
	shr r1, r0, 16
	st8 r1, r4[r6]
	shr r0, r0, 24
	mkmsk r1, 3
	st8 r0, r4[r1]
	ldc r0, 8
	ldw r6, sp[1]
	ldw r5, sp[2]
	ldw r4, sp[3]
	retsp 4
	.cc_bottom pw_number_put.function
.Lfunc_end10:
	.size	pw_number_put, .Lfunc_end10-pw_number_put

	.globl	pw_number_get
	.p2align	2
	.type	pw_number_get,@function
	.cc_top pw_number_get.function,pw_number_get
pw_number_get:
	entsp 7
	stw r4, sp[6]
	stw r5, sp[5]
	stw r6, sp[4]
	stw r7, sp[3]
	stw r8, sp[2]
	mov r5, r1
	mov r4, r0
	ldc r6, 0
	eq r0, r2, 5
	bf r0, .LBB11_3
	ldaw r1, sp[1]
	mkmsk r0, 16
	st16 r0, r1[r6]
	ldc r0, 2
	or r2, r1, r0
	ldc r3, 6
	st8 r3, r2[r6]
	mkmsk r7, 1
	ld8u r3, r5[r7]
	ld8u r0, r5[r0]
	shl r0, r0, 8
	mkmsk r2, 2
	ld8u r11, r5[r2]
	ldc r8, 4
	ld8u r8, r5[r8]
	shl r8, r8, 24
	shl r11, r11, 16
	or r0, r0, r3
	or r0, r0, r11
	or r8, r0, r8
	mov r0, r6
	bl pw_crc32
	mov r1, r5
	mov r2, r7
	bl pw_crc32
	eq r0, r8, r0
	bf r0, .LBB11_3
	ldc r0, 0
	ld8u r1, r5[r0]
	st8 r1, r4[r0]
	ldc r0, 10
	lsu r6, r1, r0
.LBB11_3:
	mov r0, r6
	ldw r8, sp[2]
	ldw r7, sp[3]
	ldw r6, sp[4]
	ldw r5, sp[5]
	ldw r4, sp[6]
	retsp 7
	.cc_bottom pw_number_get.function
.Lfunc_end11:
	.size	pw_number_get, .Lfunc_end11-pw_number_get

	.globl	pw_report_put
	.p2align	2
	.type	pw_report_put,@function
	.cc_top pw_report_put.function,pw_report_put
pw_report_put:
	entsp 5
	stw r4, sp[4]
	stw r5, sp[3]
	stw r6, sp[2]
	stw r7, sp[1]
	mov r6, r1
	mov r4, r0
	ldc r5, 0
	st8 r5, r4[r5]
	mkmsk r0, 1
	mkmsk r1, 8
	st8 r1, r4[r0]
	ldc r1, 2
	mkmsk r7, 3
	st8 r7, r4[r1]
	ld8u r1, r6[r5]
	mkmsk r2, 2
	st8 r1, r4[r2]
	ld8u r0, r6[r0]
	ldc r1, 4
	st8 r0, r4[r1]
	add r0, r6, 2
	ld16s r0, r0[r5]
	ldc r1, 5
	st8 r0, r4[r1]
	shr r0, r0, 8
	ldc r1, 6
	st8 r0, r4[r1]
	add r0, r4, 7
	add r1, r6, 4
	bl memcpy
	ld8u r0, r6[r7]
	ldc r1, 10
	st8 r0, r4[r1]
	ldw r0, r6[2]
	ldc r1, 11
	st8 r0, r4[r1]
	shr r1, r0, 8
	ldc r2, 12
	st8 r1, r4[r2]
	shr r1, r0, 16
	ldc r2, 13
	st8 r1, r4[r2]
	shr r0, r0, 24
	ldc r1, 14
	st8 r0, r4[r1]
	ldw r0, r6[3]
	mkmsk r1, 4
	st8 r0, r4[r1]
	shr r1, r0, 8
	ldc r2, 16
	st8 r1, r4[r2]
	shr r1, r0, 16
	ldc r2, 17
	st8 r1, r4[r2]
	shr r0, r0, 24
	ldc r1, 18
	st8 r0, r4[r1]
	ldw r0, r6[4]
	ldc r1, 19
	st8 r0, r4[r1]
	shr r1, r0, 8
	ldc r2, 20
	st8 r1, r4[r2]
	shr r1, r0, 16
	ldc r2, 21
	st8 r1, r4[r2]
	shr r0, r0, 24
	ldc r1, 22
	st8 r0, r4[r1]
	ldc r6, 23
	mov r0, r5
	mov r1, r4
	mov r2, r6
	bl pw_crc32
	st8 r0, r4[r6]
	shr r1, r0, 8
	ldc r2, 24
	st8 r1, r4[r2]
	shr r1, r0, 16
	ldc r2, 25
	st8 r1, r4[r2]
	shr r0, r0, 24
	ldc r1, 26
	st8 r0, r4[r1]
	ldc r0, 27
	ldw r7, sp[1]
	ldw r6, sp[2]
	ldw r5, sp[3]
	ldw r4, sp[4]
	retsp 5
	.cc_bottom pw_report_put.function
.Lfunc_end12:
	.size	pw_report_put, .Lfunc_end12-pw_report_put

	.globl	pw_report_get
	.p2align	2
	.type	pw_report_get,@function
	.cc_top pw_report_get.function,pw_report_get
pw_report_get:
	entsp 9
	stw r4, sp[8]
	stw r5, sp[7]
	stw r6, sp[6]
	stw r7, sp[5]
	stw r8, sp[4]
	stw r9, sp[3]
	stw r10, sp[2]
	mov r5, r1
	mov r4, r0
	ldc r0, 24
	ldc r6, 0
	eq r0, r2, r0
	bf r0, .LBB13_3
	ldaw r1, sp[1]
	ldc r0, 65280
	st16 r0, r1[r6]
	ldc r0, 2
	or r0, r1, r0
	mkmsk r9, 3
	st8 r9, r0[r6]
	ldc r8, 20
	ld8u r0, r5[r8]
	ldc r2, 21
	ld8u r2, r5[r2]
	shl r2, r2, 8
	ldc r3, 22
	ld8u r3, r5[r3]
	ldc r11, 23
	ld8u r11, r5[r11]
	shl r11, r11, 24
	shl r3, r3, 16
	or r0, r2, r0
	or r0, r0, r3
	or r10, r0, r11
	mkmsk r7, 2
	mov r0, r6
	mov r2, r7
	bl pw_crc32
	mov r1, r5
	mov r2, r8
	bl pw_crc32
	eq r0, r10, r0
	bf r0, .LBB13_3
	ldc r0, 0
	ld8u r6, r5[r0]
	st8 r6, r4[r0]
	mkmsk r1, 1
	ld8u r2, r5[r1]
	st8 r2, r4[r1]
	ldc r1, 2
	ld8u r1, r5[r1]
	ld8u r2, r5[r7]
	shl r2, r2, 8
	or r1, r2, r1
	add r2, r4, 2
	st16 r1, r2[r0]
	add r0, r4, 4
	add r1, r5, 4
	mov r2, r7
	bl memcpy
	ld8u r0, r5[r9]
	st8 r0, r4[r9]
	ldc r0, 8
	ld8u r1, r5[r0]
	ldc r0, 9
	ld8u r0, r5[r0]
	shl r2, r0, 8
	ldc r0, 10
	ld8u r3, r5[r0]
	ldc r11, 11
	ld8u r11, r5[r11]
	shl r11, r11, 24
	shl r3, r3, 16
	or r1, r2, r1
	or r1, r1, r3
	or r1, r1, r11
	stw r1, r4[2]
	ldc r1, 12
	ld8u r1, r5[r1]
	ldc r2, 13
	ld8u r2, r5[r2]
	shl r2, r2, 8
	ldc r3, 14
	ld8u r3, r5[r3]
	mkmsk r11, 4
	ld8u r11, r5[r11]
	shl r11, r11, 24
	shl r3, r3, 16
	or r1, r2, r1
	or r1, r1, r3
	or r1, r1, r11
	stw r1, r4[3]
	ldc r1, 16
	ld8u r1, r5[r1]
	ldc r2, 17
	ld8u r2, r5[r2]
	shl r2, r2, 8
	ldc r3, 18
	ld8u r3, r5[r3]
	ldc r11, 19
	ld8u r11, r5[r11]
	shl r11, r11, 24
	shl r3, r3, 16
	or r1, r2, r1
	or r1, r1, r3
	or r1, r1, r11
	stw r1, r4[4]
	lsu r6, r6, r0
.LBB13_3:
	mov r0, r6
	ldw r10, sp[2]
	ldw r9, sp[3]
	ldw r8, sp[4]
	ldw r7, sp[5]
	ldw r6, sp[6]
	ldw r5, sp[7]
	ldw r4, sp[8]
	retsp 9
	.cc_bottom pw_report_get.function
.Lfunc_end13:
	.size	pw_report_get, .Lfunc_end13-pw_report_get

	.globl	pw_playing_put
	.p2align	2
	.type	pw_playing_put,@function
	.cc_top pw_playing_put.function,pw_playing_put
pw_playing_put:
	entsp 4
	stw r4, sp[3]
	stw r5, sp[2]
	stw r6, sp[1]
	mov r4, r0
	ldc r5, 0
	st8 r5, r4[r5]
	mkmsk r0, 1
	mkmsk r2, 8
	st8 r2, r4[r0]
	ldc r0, 2
	ldc r2, 8
	st8 r2, r4[r0]
	ld8u r0, r1[r5]
	mkmsk r3, 2
	st8 r0, r4[r3]
	ldw r0, r1[2]
	ldw r3, r1[1]
	ldc r11, 4
	st8 r3, r4[r11]
	shr r11, r3, 8
	ldc r6, 5
	st8 r11, r4[r6]
	shr r11, r3, 16
	ldc r6, 6
	st8 r11, r4[r6]
	shr r3, r3, 24
	mkmsk r11, 3
	st8 r3, r4[r11]
	st8 r0, r4[r2]
	shr r2, r0, 8
	ldc r3, 9
	st8 r2, r4[r3]
	shr r2, r0, 16
	ldc r3, 10
	st8 r2, r4[r3]
	shr r0, r0, 24
	ldc r2, 11
	st8 r0, r4[r2]
	ldaw r0, r4[3]
	ldaw r1, r1[3]
	ldc r2, 48
	bl memcpy
	ldc r6, 60
	mov r0, r5
	mov r1, r4
	mov r2, r6
	bl pw_crc32
	st8 r0, r4[r6]
	shr r1, r0, 8
	ldc r2, 61
	st8 r1, r4[r2]
	shr r1, r0, 16
	ldc r2, 62
	st8 r1, r4[r2]
	shr r0, r0, 24
	mkmsk r1, 6
	st8 r0, r4[r1]
	ldc r0, 64
	ldw r6, sp[1]
	ldw r5, sp[2]
	ldw r4, sp[3]
	retsp 4
	.cc_bottom pw_playing_put.function
.Lfunc_end14:
	.size	pw_playing_put, .Lfunc_end14-pw_playing_put

	.globl	pw_playing_get
	.p2align	2
	.type	pw_playing_get,@function
	.cc_top pw_playing_get.function,pw_playing_get
pw_playing_get:
	entsp 9
	stw r4, sp[8]
	stw r5, sp[7]
	stw r6, sp[6]
	stw r7, sp[5]
	stw r8, sp[4]
	stw r9, sp[3]
	stw r10, sp[2]
	mov r4, r1
	mov r5, r0
	ldc r0, 61
	ldc r6, 0
	eq r0, r2, r0
	bf r0, .LBB15_3
	ldaw r1, sp[1]
	ldc r0, 65280
	st16 r0, r1[r6]
	ldc r10, 2
	or r0, r1, r10
	ldc r2, 8
	st8 r2, r0[r6]
	ldc r8, 57
	ld8u r0, r4[r8]
	ldc r2, 58
	ld8u r2, r4[r2]
	shl r2, r2, 8
	ldc r3, 59
	ld8u r3, r4[r3]
	ldc r11, 60
	ld8u r11, r4[r11]
	shl r11, r11, 24
	shl r3, r3, 16
	or r0, r2, r0
	or r0, r0, r3
	or r9, r0, r11
	mkmsk r7, 2
	mov r0, r6
	mov r2, r7
	bl pw_crc32
	mov r1, r4
	mov r2, r8
	bl pw_crc32
	eq r0, r9, r0
	bf r0, .LBB15_3
	ldc r0, 0
	ld8u r6, r4[r0]
	st8 r6, r5[r0]
	mkmsk r0, 1
	ld8u r0, r4[r0]
	ld8u r1, r4[r10]
	shl r1, r1, 8
	ld8u r2, r4[r7]
	ldc r3, 4
	ld8u r3, r4[r3]
	shl r3, r3, 24
	shl r2, r2, 16
	or r0, r1, r0
	or r0, r0, r2
	or r0, r0, r3
	ldc r1, 5
	ld8u r1, r4[r1]
	ldc r2, 6
	ld8u r2, r4[r2]
	shl r2, r2, 8
	mkmsk r3, 3
	ld8u r3, r4[r3]
	ldc r11, 8
	ld8u r11, r4[r11]
	shl r11, r11, 24
	shl r3, r3, 16
	or r1, r2, r1
	or r1, r1, r3
	or r1, r1, r11
	stw r1, r5[2]
	stw r0, r5[1]
	ldaw r0, r5[3]
	add r1, r4, 9
	ldc r2, 48
	bl memcpy
	ldc r0, 10
	lsu r6, r6, r0
.LBB15_3:
	mov r0, r6
	ldw r10, sp[2]
	ldw r9, sp[3]
	ldw r8, sp[4]
	ldw r7, sp[5]
	ldw r6, sp[6]
	ldw r5, sp[7]
	ldw r4, sp[8]
	retsp 9
	.cc_bottom pw_playing_get.function
.Lfunc_end15:
	.size	pw_playing_get, .Lfunc_end15-pw_playing_get

	.globl	pw_identity_put
	.p2align	2
	.type	pw_identity_put,@function
	.cc_top pw_identity_put.function,pw_identity_put
pw_identity_put:
	entsp 4
	stw r4, sp[3]
	stw r5, sp[2]
	stw r6, sp[1]
	mov r6, r1
	mov r4, r0
	ldc r5, 0
	st8 r5, r4[r5]
	mkmsk r0, 1
	mkmsk r1, 8
	st8 r1, r4[r0]
	ldc r1, 2
	ldc r2, 9
	st8 r2, r4[r1]
	ld8u r1, r6[r5]
	mkmsk r2, 2
	st8 r1, r4[r2]
	ld8u r0, r6[r0]
	ldc r1, 4
	st8 r0, r4[r1]
	add r0, r4, 5
	add r1, r6, 2
	bl memcpy
	add r0, r4, 8
	add r1, r6, 5
	ldc r2, 8
	bl memmove
	ldc r6, 16
	mov r0, r5
	mov r1, r4
	mov r2, r6
	bl pw_crc32
	st8 r0, r4[r6]
	shr r1, r0, 8
	ldc r2, 17
	st8 r1, r4[r2]
	shr r1, r0, 16
	ldc r2, 18
	st8 r1, r4[r2]
	shr r0, r0, 24
	ldc r1, 19
	st8 r0, r4[r1]
	ldc r0, 20
	ldw r6, sp[1]
	ldw r5, sp[2]
	ldw r4, sp[3]
	retsp 4
	.cc_bottom pw_identity_put.function
.Lfunc_end16:
	.size	pw_identity_put, .Lfunc_end16-pw_identity_put

	.globl	pw_identity_get
	.p2align	2
	.type	pw_identity_get,@function
	.cc_top pw_identity_get.function,pw_identity_get
pw_identity_get:
	entsp 8
	stw r4, sp[7]
	stw r5, sp[6]
	stw r6, sp[5]
	stw r7, sp[4]
	stw r8, sp[3]
	stw r9, sp[2]
	mov r4, r1
	mov r5, r0
	ldc r0, 17
	ldc r6, 0
	eq r0, r2, r0
	bf r0, .LBB17_3
	ldaw r1, sp[1]
	ldc r0, 65280
	st16 r0, r1[r6]
	ldc r8, 2
	or r0, r1, r8
	ldc r2, 9
	st8 r2, r0[r6]
	ldc r7, 13
	ld8u r0, r4[r7]
	ldc r2, 14
	ld8u r2, r4[r2]
	shl r2, r2, 8
	mkmsk r3, 4
	ld8u r3, r4[r3]
	ldc r11, 16
	ld8u r11, r4[r11]
	shl r11, r11, 24
	shl r3, r3, 16
	or r0, r2, r0
	or r0, r0, r3
	or r9, r0, r11
	mkmsk r2, 2
	mov r0, r6
	bl pw_crc32
	mov r1, r4
	mov r2, r7
	bl pw_crc32
	eq r0, r9, r0
	bf r0, .LBB17_3
	ldc r0, 0
	ld8u r6, r4[r0]
	st8 r6, r5[r0]
	mkmsk r0, 1
	ld8u r7, r4[r0]
	st8 r7, r5[r0]
	add r0, r5, 2
	add r1, r4, 2
	mkmsk r2, 2
	bl memcpy
	add r0, r5, 5
	add r1, r4, 5
	ldc r2, 8
	bl memmove
	ldc r0, 10
	lsu r0, r6, r0
	lsu r1, r7, r8
	and r6, r0, r1
.LBB17_3:
	mov r0, r6
	ldw r9, sp[2]
	ldw r8, sp[3]
	ldw r7, sp[4]
	ldw r6, sp[5]
	ldw r5, sp[6]
	ldw r4, sp[7]
	retsp 8
	.cc_bottom pw_identity_get.function
.Lfunc_end17:
	.size	pw_identity_get, .Lfunc_end17-pw_identity_get

	.section	.cp.rodata.cst16,"aMc",@progbits,16
	.cc_top memories.data,memories
	.p2align	2
	.type	memories,@object
	.size	memories, 16
memories:
	.short	0
	.byte	48
	.space	1
	.short	256
	.byte	48
	.space	1
	.short	1024
	.byte	4
	.space	1
	.short	4096
	.byte	1
	.space	1
	.cc_bottom memories.data
	.ident	"Debian clang version 14.0.6"
	.section	".note.GNU-stack","",@progbits
