# Made by clang from num.c; do not edit.
# sha256 of it and what it includes: d148c56f4481a4a0c813b8d752fa0c49e178967a7a37048e7d21c123ac8b0843
	.text
	.globl	pw_device_block
	.p2align	2
	.type	pw_device_block,@function
	.cc_top pw_device_block.function,pw_device_block
pw_device_block:
	entsp 18
	stw r4, sp[17]
	stw r5, sp[16]
	stw r6, sp[15]
	stw r7, sp[14]
	stw r8, sp[13]
	stw r9, sp[12]
	stw r10, sp[11]
	mov r5, r2
	stw r1, sp[1]
	mov r6, r0
	ldw r4, sp[20]
	ldw r10, sp[19]
	ldw r7, sp[21]
	ldaw r2, sp[4]
	mov r0, r5
	stw r3, sp[3]
	mov r1, r3
	stw r2, sp[2]
	bl pw_block_check
	mov r9, r0
	bt r9, .LBB0_2
	ldaw r1, sp[4]
	mov r0, r6
	mov r2, r10
	mov r3, r4
	bl judge
	mov r9, r0
.LBB0_2:
	ldc r8, 0
	st8 r9, r7[r8]
	mov r0, r5
	ldw r1, sp[3]
	bl pw_block_number
	stw r0, r7[1]
	stw r8, r7[3]
	stw r8, r7[2]
	stw r4, r7[5]
	stw r10, r7[4]
	ldc r0, 24
	st8 r8, r7[r0]
	ldc r0, 56
	add r0, r6, r0
	ldw r0, r0[0]
	ldc r1, 26
	st8 r0, r7[r1]
	bf r9, .LBB0_3
	ldc r0, 104
	add r0, r6, r0
	ldw r1, r0[0]
	add r1, r1, 1
	stw r1, r0[0]
	ldc r0, 120
	st8 r9, r6[r0]
.LBB0_21:
	mov r0, r6
	bl pw_free_places
	ldc r1, 25
	st8 r0, r7[r1]
	ldw r10, sp[11]
	ldw r9, sp[12]
	ldw r8, sp[13]
	ldw r7, sp[14]
	ldw r6, sp[15]
	ldw r5, sp[16]
	ldw r4, sp[17]
	retsp 18
.LBB0_3:
	ldaw r10, r7[6]
	ldc r1, 92
	add r0, r6, r1
	ld8u r2, r6[r1]
	ldc r1, 96
	ldw r9, sp[2]
	bt r2, .LBB0_7
	mkmsk r2, 1
	or r2, r9, r2
	ldc r3, 0
	ld8u r2, r2[r3]
	zext r2, 1
	bt r2, .LBB0_7
	ldw r2, sp[5]
	add r3, r6, r1
	ldw r3, r3[0]
	not r3, r3
	add r3, r2, r3
	ldc r11, 112
	add r11, r6, r11
	ldw r5, r11[0]
	add r5, r5, r3
	stw r5, r11[0]
	bf r3, .LBB0_7
	ldc r3, 2
	bu .LBB0_8
.LBB0_7:
	ldc r3, 0
	ldw r2, sp[5]
.LBB0_8:
	ld8u r11, r10[r8]
	or r3, r11, r3
	st8 r3, r10[r8]
	st8 r8, r0[r8]
	add r0, r6, r1
	stw r2, r0[0]
	ldc r0, 100
	add r0, r6, r0
	ldw r1, r0[0]
	add r1, r1, 1
	stw r1, r0[0]
	ldw r0, r6[4]
	ldw r1, r6[5]
	ldc r2, 68
	add r2, r6, r2
	stw r1, r2[1]
	stw r0, r2[0]
	ld8u r0, r9[r8]
	bl pw_kind_is_change
	bf r0, .LBB0_15
	ldaw r5, sp[4]
	mov r0, r6
	mov r1, r5
	ldw r2, sp[1]
	bl queue
	stw r1, r7[3]
	stw r0, r7[2]
	ldw r3, sp[7]
	ldw r2, sp[6]
	or r11, r2, r3
	bf r11, .LBB0_12
	xor r0, r0, r2
	xor r1, r1, r3
	or r0, r0, r1
	bf r0, .LBB0_12
	ldc r0, 0
	ld8u r1, r10[r0]
	mkmsk r4, 1
	or r1, r1, r4
	st8 r1, r10[r0]
	ldc r0, 108
	add r0, r6, r0
	ldw r1, r0[0]
	add r1, r1, 1
	stw r1, r0[0]
.LBB0_12:
	ldc r0, 0
	ld8u r0, r5[r0]
	eq r0, r0, 1
	bf r0, .LBB0_21
	bf r11, .LBB0_21
	ldc r0, 18573
	mkmsk r1, 1
	st8 r1, r6[r0]
	ldc r0, 18576
	add r0, r6, r0
	stw r3, r0[1]
	stw r2, r0[0]
	bu .LBB0_21
.LBB0_15:
	ld8u r0, r9[r8]
	bl pw_kind_is_store
	bf r0, .LBB0_17
	ldaw r1, sp[4]
	mov r0, r6
	bl pw_add_store
	bu .LBB0_21
.LBB0_17:
	ld8u r0, r9[r8]
	eq r1, r0, 8
	mov r0, r8
	bf r1, .LBB0_19
	ldw r0, r6[9]
	ldw r8, r6[8]
.LBB0_19:
	stw r8, r7[2]
	stw r0, r7[3]
	bu .LBB0_21
	.cc_bottom pw_device_block.function
.Lfunc_end0:
	.size	pw_device_block, .Lfunc_end0-pw_device_block

	.p2align	2
	.type	judge,@function
	.cc_top judge.function,judge
judge:
	entsp 8
	stw r4, sp[7]
	stw r5, sp[6]
	stw r6, sp[5]
	stw r7, sp[4]
	stw r8, sp[3]
	stw r9, sp[2]
	stw r10, sp[1]
	mov r7, r3
	mov r8, r2
	mov r4, r1
	mov r5, r0
	ldc r6, 0
	ld8u r0, r4[r6]
	bl pw_kind_is_change
	mov r9, r0
	mov r0, r4
	bl pw_block_features
	mkmsk r1, 7
	lsu r0, r1, r0
	bt r0, .LBB1_1
	ldc r0, 60
	ld8u r0, r5[r0]
	ldc r1, 30
	and r0, r0, r1
	bf r0, .LBB1_9
	ldc r10, 9
	bt r9, .LBB1_23
	ld8u r0, r4[r6]
	bl pw_kind_is_store
	bf r0, .LBB1_5
	bu .LBB1_23
.LBB1_1:
	ldc r10, 8
	bu .LBB1_23
.LBB1_9:
	bf r9, .LBB1_5
	ldc r0, 56
	add r0, r5, r0
	ldw r0, r0[0]
	bl pw_state_enabled
	bf r0, .LBB1_11
.LBB1_5:
	ldc r0, 92
	ld8u r0, r5[r0]
	bf r0, .LBB1_6
.LBB1_12:
	bf r9, .LBB1_22
	ldw r9, r4[2]
	ldw r10, r4[3]
	ldc r2, 50
	mov r0, r8
	mov r1, r7
	mov r3, r6
	bl __udivdi3
	eq r2, r10, r1
	bt r2, .LBB1_14
	lsu r2, r1, r10
	bu .LBB1_16
.LBB1_6:
	mkmsk r0, 1
	ld8u r1, r4[r0]
	zext r1, 1
	bt r1, .LBB1_12
	ldw r1, r4[1]
	ldc r2, 96
	add r2, r5, r2
	ldw r2, r2[0]
	sub r1, r1, r2
	lss r0, r1, r0
	bf r0, .LBB1_12
	ldc r10, 11
	bu .LBB1_23
.LBB1_11:
	ldc r10, 10
	bu .LBB1_23
.LBB1_14:
	lsu r2, r0, r9
.LBB1_16:
	eq r2, r2, 0
	lsub r3, r0, r9, r0, r6
	lsub r3, r1, r10, r1, r3
	bt r2, .LBB1_22
	eq r2, r1, 1
	bt r2, .LBB1_18
	mkmsk r0, 1
	lsu r0, r0, r1
	bt r0, .LBB1_21
.LBB1_22:
	mov r0, r5
	mov r1, r4
	bl pw_judge_stores
	mov r10, r0
	bu .LBB1_23
.LBB1_18:
	eq r0, r0, 0
	eq r0, r0, 0
	bf r0, .LBB1_22
.LBB1_21:
	ldc r10, 12
.LBB1_23:
	mov r0, r10
	ldw r10, sp[1]
	ldw r9, sp[2]
	ldw r8, sp[3]
	ldw r7, sp[4]
	ldw r6, sp[5]
	ldw r5, sp[6]
	ldw r4, sp[7]
	retsp 8
	.cc_bottom judge.function
.Lfunc_end1:
	.size	judge, .Lfunc_end1-judge

	.globl	pw_device_test
	.p2align	2
	.type	pw_device_test,@function
	.cc_top pw_device_test.function,pw_device_test
pw_device_test:
	entsp 133
	stw r4, sp[132]
	stw r5, sp[131]
	stw r6, sp[130]
	stw r7, sp[129]
	stw r8, sp[128]
	mov r8, r2
	mov r5, r1
	mov r4, r0
	ldaw r7, sp[8]
	ldc r6, 0
	ldc r2, 480
	mov r0, r7
	mov r1, r6
	bl memset
	ldaw r11, cp[.L__const.pw_device_test.weak]
	mov r2, r11
	mov r0, r7
	mov r1, r8
	bl pw_pulse_put
	ldaw r8, sp[1]
	ldc r2, 24
	mov r0, r8
	mov r1, r6
	bl memset
	ldc r0, 257
	st16 r0, r8[r6]
	stw r7, sp[7]
	mov r0, r4
	bl pw_device_poll
	ldw r3, r4[5]
	ldw r2, r4[4]
	mov r0, r4
	mov r1, r8
	bl judge
	bf r0, .LBB2_2
	ldc r1, 104
	add r1, r4, r1
	ldw r2, r1[0]
	add r2, r2, 1
	stw r2, r1[0]
	ldc r1, 120
	st8 r0, r4[r1]
	bu .LBB2_5
.LBB2_2:
	mov r0, r4
	bl pw_device_has_room
	bf r0, .LBB2_3
	ldc r0, 100
	add r0, r4, r0
	ldw r1, r0[0]
	add r1, r1, 1
	stw r1, r0[0]
	ldw r0, r4[4]
	ldw r1, r4[5]
	ldc r2, 68
	add r2, r4, r2
	stw r1, r2[1]
	stw r0, r2[0]
	ldaw r1, sp[1]
	mov r0, r4
	mov r2, r5
	bl queue
	mov r0, r6
	bu .LBB2_5
.LBB2_3:
	mkmsk r0, 32
.LBB2_5:
	ldw r8, sp[128]
	ldw r7, sp[129]
	ldw r6, sp[130]
	ldw r5, sp[131]
	ldw r4, sp[132]
	retsp 133
	.cc_bottom pw_device_test.function
.Lfunc_end2:
	.size	pw_device_test, .Lfunc_end2-pw_device_test

	.p2align	2
	.type	queue,@function
	.cc_top queue.function,queue
queue:
	entsp 10
	stw r4, sp[9]
	stw r5, sp[8]
	stw r6, sp[7]
	stw r7, sp[6]
	stw r8, sp[5]
	stw r9, sp[4]
	stw r10, sp[3]
	mov r9, r2
	mov r5, r1
	mov r4, r0
	ldc r10, 0
	ld8u r1, r5[r10]
	ldc r0, 2
	ld8u r2, r5[r0]
	mov r0, r4
	bl pw_first_period
	ldw r6, r5[2]
	ldw r7, r5[3]
	eq r2, r7, r1
	bt r2, .LBB3_1
	lsu r2, r1, r7
	bf r2, .LBB3_4
	bu .LBB3_5
.LBB3_1:
	lsu r2, r0, r6
	bt r2, .LBB3_5
.LBB3_4:
	mov r6, r0
.LBB3_5:
	bt r2, .LBB3_7
	mov r7, r1
.LBB3_7:
	mov r0, r4
	bl pw_change_add
	mov r8, r0
	stw r7, r8[1]
	stw r6, r8[0]
	ld8u r0, r5[r10]
	ldc r1, 16
	st8 r0, r8[r1]
	ldc r0, 2
	ld8u r0, r5[r0]
	ldc r1, 17
	st8 r0, r8[r1]
	mkmsk r0, 1
	ld8u r0, r5[r0]
	ldc r1, 18
	st8 r0, r8[r1]
	ldc r0, 22
	st8 r9, r8[r0]
	ldaw r2, r5[4]
	ld16s r2, r2[r10]
	ldaw r3, r8[6]
	st16 r2, r3[r10]
	add r1, r5, r1
	ld16s r1, r1[r10]
	ldc r2, 26
	add r2, r8, r2
	st16 r1, r2[r10]
	ldaw r1, r5[5]
	ld16s r1, r1[r10]
	ldaw r2, r8[7]
	st16 r1, r2[r10]
	add r0, r5, r0
	ld16s r0, r0[r10]
	ldc r1, 30
	add r1, r8, r1
	st16 r0, r1[r10]
	ld8u r0, r5[r10]
	eq r1, r0, 1
	bf r1, .LBB3_9
	ldw r0, r5[6]
	ldw r1, r4[1]
	ldw r1, r1[6]
	ldaw r2, r8[8]
	bl pw_pulses_sort
	ld8u r0, r5[r10]
.LBB3_9:
	eq r0, r0, 4
	bf r0, .LBB3_10
	mov r0, r4
	mov r1, r5
	mov r2, r6
	mov r3, r7
	bl pw_sequence_end
	stw r1, r8[3]
	stw r0, r8[2]
	bu .LBB3_12
.LBB3_10:
	ldw r1, r8[3]
	ldw r0, r8[2]
.LBB3_12:
	stw r0, sp[1]
	stw r1, sp[2]
	mov r0, r4
	mov r1, r5
	mov r2, r6
	mov r3, r7
	bl pw_note_uses
	ldc r0, 18564
	add r0, r4, r0
	stw r7, r0[1]
	stw r6, r0[0]
	ld8u r0, r5[r10]
	ldc r1, 2
	ld8u r1, r5[r1]
	bl pw_has_slices
	mkmsk r1, 1
	xor r0, r0, r1
	ldc r1, 18572
	st8 r0, r4[r1]
	mov r0, r6
	mov r1, r7
	ldw r10, sp[3]
	ldw r9, sp[4]
	ldw r8, sp[5]
	ldw r7, sp[6]
	ldw r6, sp[7]
	ldw r5, sp[8]
	ldw r4, sp[9]
	retsp 10
	.cc_bottom queue.function
.Lfunc_end3:
	.size	queue, .Lfunc_end3-queue

	.section	.cp.rodata,"ac",@progbits
	.cc_top .L__const.pw_device_test.weak.data,.L__const.pw_device_test.weak
	.p2align	2
	.type	.L__const.pw_device_test.weak,@object
	.size	.L__const.pw_device_test.weak, 2
.L__const.pw_device_test.weak:
	.byte	0
	.byte	2
	.space	2
	.cc_bottom .L__const.pw_device_test.weak.data
	.ident	"Debian clang version 14.0.6"
	.section	".note.GNU-stack","",@progbits
