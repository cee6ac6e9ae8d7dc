# Made by clang from blk_stores.c; do not edit.
# sha256 of it and what it includes: ac3ca2c472cff9873ee81fde6d2d81bdcc66ea8d9af2e9fc036c571e242802da
	.text
	.section	.cp.rodata.cst4,"aMc",@progbits,4
	.p2align	2
.LCPI0_0:
	.long	4294967282
.LCPI0_1:
	.long	4294967290
	.text
	.globl	pw_judge_stores
	.p2align	2
	.type	pw_judge_stores,@function
	.cc_top pw_judge_stores.function,pw_judge_stores
pw_judge_stores:
	entsp 13
	stw r4, sp[12]
	stw r5, sp[11]
	stw r6, sp[10]
	stw r7, sp[9]
	stw r8, sp[8]
	stw r9, sp[7]
	stw r10, sp[6]
	mov r5, r1
	mov r4, r0
	ldc r9, 0
	ld8u r0, r5[r9]
	sub r1, r0, 1
	zext r1, 8
	mkmsk r2, 1
	lsu r1, r2, r1
	bt r1, .LBB0_4
	ldw r0, r5[6]
	ldc r1, 320
	bl pw_pulses_power
	ldc r1, 78
	add r2, r4, r1
	ldc r1, 0
	ld16s r2, r2[r1]
	zext r2, 16
	ldc r3, 1000
	mul r2, r2, r3
	lsu r0, r2, r0
	bf r0, .LBB0_3
.LBB0_2:
	ldc r9, 14
	bu .LBB0_34
.LBB0_3:
	ld8u r0, r5[r1]
.LBB0_4:
	eq r1, r0, 6
	bt r1, .LBB0_13
	eq r1, r0, 4
	bf r1, .LBB0_18
	stw r4, sp[2]
	ldc r0, 18
	add r0, r5, r0
	ldc r9, 0
	stw r0, sp[4]
	ld16s r0, r0[r9]
	zext r0, 16
	bf r0, .LBB0_34
	ldc r0, 18604
	ldw r1, sp[2]
	add r0, r1, r0
	stw r0, sp[3]
	ldc r0, 78
	add r0, r1, r0
	stw r0, sp[1]
	ldc r4, 0
	ldaw r8, r5[4]
	ldaw r5, sp[5]
	ldc r0, 2
	or r6, r5, r0
	mov r10, r4
	mov r9, r4
	bu .LBB0_9
.LBB0_8:
	add r10, r10, 1
	ldw r0, sp[4]
	ld16s r0, r0[r4]
	zext r0, 16
	lsu r0, r10, r0
	bf r0, .LBB0_34
.LBB0_9:
	mov r7, r9
	ld16s r0, r8[r4]
	zext r0, 16
	add r2, r10, r0
	mov r0, r5
	ldw r1, sp[3]
	bl pw_entry_get
	ld16s r0, r6[r4]
	zext r0, 16
	mkmsk r9, 4
	bf r0, .LBB0_8
	ld16s r0, r5[r4]
	zext r0, 16
	ldw r1, sp[2]
	ldaw r0, r1[r0]
	ldc r1, 22700
	add r0, r0, r1
	ldw r0, r0[0]
	mkmsk r1, 32
	eq r1, r0, r1
	mkmsk r9, 4
	bt r1, .LBB0_8
	ldw r1, sp[1]
	ld16s r1, r1[r4]
	zext r1, 16
	ldc r2, 1000
	mul r1, r1, r2
	lsu r0, r1, r0
	mov r9, r7
	bf r0, .LBB0_8
	bu .LBB0_2
.LBB0_13:
	ldc r0, 18
	add r0, r5, r0
	ldc r9, 0
	ld16s r0, r0[r9]
	zext r0, 16
	bf r0, .LBB0_34
	ldaw r2, r5[4]
	ldc r1, 0
	ld16s r2, r2[r1]
	zext r2, 16
	ldc r3, 23724
	mkmsk r9, 4
	mov r5, r4
.LBB0_15:
	shr r11, r2, 3
	add r11, r5, r11
	ld8u r11, r11[r3]
	mov r4, r2
	zext r4, 3
	shr r11, r11, r4
	zext r11, 1
	bf r11, .LBB0_34
	sub r0, r0, 1
	add r2, r2, 1
	bt r0, .LBB0_15
	mov r9, r1
	bu .LBB0_34
.LBB0_18:
	bl pw_kind_is_store
	bf r0, .LBB0_34
	ldc r0, 27692
	mov r1, r4
	add r0, r4, r0
	ldw r8, r0[0]
	bf r8, .LBB0_34
	mov r6, r1
	ldw r0, r6[4]
	ldw r1, r6[5]
	ldc r2, 50
	ldc r4, 0
	mov r3, r4
	bl __udivdi3
	ldc r2, 24250
	add r2, r6, r2
	ldw r3, cp[.LCPI0_0]
	ldc r6, 18
	add r11, r5, r6
	stw r11, sp[4]
	ldc r9, 16
	ldc r10, 48
	bu .LBB0_23
.LBB0_21:
	ldw r11, cp[.LCPI0_1]
	ld8u r11, r2[r11]
	bf r11, .LBB0_31
.LBB0_22:
	add r2, r2, r10
	sub r8, r8, 1
	bf r8, .LBB0_33
.LBB0_23:
	add r6, r2, r3
	ldw r7, r6[1]
	eq r11, r7, r1
	bt r11, .LBB0_25
	lsu r11, r1, r7
	eq r6, r11, 0
	bt r6, .LBB0_22
	bu .LBB0_26
.LBB0_25:
	ldw r11, r6[0]
	lsu r11, r0, r11
	eq r6, r11, 0
	bt r6, .LBB0_22
.LBB0_26:
	ld8u r6, r5[r4]
	eq r11, r6, 3
	bt r11, .LBB0_21
	eq r11, r6, 2
	bf r11, .LBB0_30
	ldw r11, cp[.LCPI0_1]
	ld8u r11, r2[r11]
	bt r11, .LBB0_22
	ldaw r11, r5[4]
	ld16s r11, r11[r4]
	ldc r6, 65528
	and r6, r11, r6
	shr r6, r6, 3
	ld8u r6, r2[r6]
	zext r11, 3
	shr r11, r6, r11
	zext r11, 1
	bf r11, .LBB0_22
	bu .LBB0_34
.LBB0_30:
	ldw r11, cp[.LCPI0_1]
	ld8u r11, r2[r11]
	bf r11, .LBB0_22
.LBB0_31:
	ldaw r11, r5[4]
	ld16s r7, r11[r4]
	zext r7, 16
	ldw r11, sp[4]
	ld16s r11, r11[r4]
	zext r11, 16
	sub r6, r2, 4
	ld16s r6, r6[r4]
	zext r6, 16
	add r11, r11, r7
	lsu r11, r6, r11
	bf r11, .LBB0_22
	sub r11, r2, 2
	ld16s r11, r11[r4]
	zext r11, 16
	add r11, r11, r6
	lsu r11, r7, r11
	bf r11, .LBB0_22
	bu .LBB0_34
.LBB0_33:
	mov r9, r4
.LBB0_34:
	mov r0, r9
	ldw r10, sp[6]
	ldw r9, sp[7]
	ldw r8, sp[8]
	ldw r7, sp[9]
	ldw r6, sp[10]
	ldw r5, sp[11]
	ldw r4, sp[12]
	retsp 13
	.cc_bottom pw_judge_stores.function
.Lfunc_end0:
	.size	pw_judge_stores, .Lfunc_end0-pw_judge_stores

	.globl	pw_end_uses
	.p2align	2
	.type	pw_end_uses,@function
	.cc_top pw_end_uses.function,pw_end_uses
pw_end_uses:
	entsp 13
	stw r4, sp[12]
	stw r5, sp[11]
	stw r6, sp[10]
	stw r7, sp[9]
	stw r8, sp[8]
	stw r9, sp[7]
	stw r10, sp[6]
	stw r3, sp[2]
	stw r2, sp[3]
	stw r1, sp[1]
	mov r7, r0
	ldc r0, 27692
	add r0, r7, r0
	stw r0, sp[5]
	ldw r0, r0[0]
	bf r0, .LBB1_1
	ldw r6, sp[14]
	ldc r0, 24236
	add r8, r7, r0
	ldc r5, 0
	ldc r4, 48
	stw r5, sp[4]
	bu .LBB1_4
.LBB1_17:
	add r5, r5, 1
	ldw r0, sp[5]
	ldw r0, r0[0]
	add r8, r8, r4
	lsu r0, r5, r0
	bf r0, .LBB1_2
.LBB1_4:
	ldc r0, 8
	ld8u r0, r8[r0]
	bf r0, .LBB1_6
	ldw r0, sp[3]
	bt r0, .LBB1_7
	bu .LBB1_12
.LBB1_6:
	ldw r0, sp[1]
	bf r0, .LBB1_12
.LBB1_7:
	ldw r0, r8[1]
	eq r1, r0, r6
	bt r1, .LBB1_8
	lsu r0, r6, r0
	eq r0, r0, 0
	bf r0, .LBB1_11
	bu .LBB1_12
.LBB1_8:
	ldw r0, r8[0]
	ldw r1, sp[2]
	lsu r0, r1, r0
	eq r0, r0, 0
	bt r0, .LBB1_12
.LBB1_11:
	ldw r0, sp[2]
	stw r0, r8[0]
	stw r6, r8[1]
.LBB1_12:
	mov r9, r4
	ldw r10, r8[0]
	ldw r4, r8[1]
	ldw r0, r7[4]
	ldw r1, r7[5]
	ldc r2, 50
	ldc r3, 0
	bl __udivdi3
	eq r2, r4, r1
	bt r2, .LBB1_13
	lsu r0, r1, r4
	bu .LBB1_15
.LBB1_13:
	lsu r0, r0, r10
.LBB1_15:
	eq r0, r0, 0
	mov r4, r9
	bt r0, .LBB1_17
	ldc r0, 24236
	ldw r9, sp[4]
	lmul r1, r0, r9, r4, r7, r0
	mov r1, r8
	mov r2, r4
	bl __memcpy_4
	add r9, r9, 1
	stw r9, sp[4]
	bu .LBB1_17
.LBB1_1:
	ldc r0, 0
	stw r0, sp[4]
.LBB1_2:
	ldw r0, sp[5]
	ldw r1, sp[4]
	stw r1, r0[0]
	ldw r10, sp[6]
	ldw r9, sp[7]
	ldw r8, sp[8]
	ldw r7, sp[9]
	ldw r6, sp[10]
	ldw r5, sp[11]
	ldw r4, sp[12]
	retsp 13
	.cc_bottom pw_end_uses.function
.Lfunc_end1:
	.size	pw_end_uses, .Lfunc_end1-pw_end_uses

	.globl	pw_sequence_end
	.p2align	2
	.type	pw_sequence_end,@function
	.cc_top pw_sequence_end.function,pw_sequence_end
pw_sequence_end:
	entsp 14
	stw r4, sp[13]
	stw r5, sp[12]
	stw r6, sp[11]
	stw r7, sp[10]
	stw r8, sp[9]
	stw r9, sp[8]
	stw r10, sp[7]
	stw r3, sp[2]
	stw r2, sp[3]
	ldc r2, 18
	add r6, r1, r2
	ldc r10, 0
	ld16s r2, r6[r10]
	zext r2, 16
	stw r1, sp[1]
	bf r2, .LBB2_1
	ldc r2, 18604
	add r0, r0, r2
	stw r0, sp[5]
	ldc r7, 0
	ldaw r0, r1[4]
	stw r0, sp[4]
	ldaw r8, sp[6]
	ldc r0, 2
	or r9, r8, r0
	mov r4, r7
	mov r5, r7
	mov r10, r7
.LBB2_8:
	ldw r0, sp[4]
	ld16s r0, r0[r7]
	zext r0, 16
	add r2, r4, r0
	mov r0, r8
	ldw r1, sp[5]
	bl pw_entry_get
	ld16s r0, r9[r7]
	zext r0, 16
	ladd r0, r5, r5, r0, r7
	add r10, r10, r0
	add r4, r4, 1
	ld16s r0, r6[r7]
	zext r0, 16
	lsu r0, r4, r0
	bt r0, .LBB2_8
	bu .LBB2_2
.LBB2_1:
	mov r5, r10
.LBB2_2:
	ldc r0, 22
	ldw r1, sp[1]
	add r0, r1, r0
	ldc r1, 0
	ld16s r2, r0[r1]
	zext r2, 16
	ldw r0, sp[3]
	ldw r3, sp[2]
	maccu r3, r0, r5, r2
	mkmsk r1, 32
	bt r2, .LBB2_4
	mov r0, r1
.LBB2_4:
	bf r2, .LBB2_6
	mul r1, r10, r2
	add r1, r3, r1
.LBB2_6:
	ldw r10, sp[7]
	ldw r9, sp[8]
	ldw r8, sp[9]
	ldw r7, sp[10]
	ldw r6, sp[11]
	ldw r5, sp[12]
	ldw r4, sp[13]
	retsp 14
	.cc_bottom pw_sequence_end.function
.Lfunc_end2:
	.size	pw_sequence_end, .Lfunc_end2-pw_sequence_end

	.globl	pw_note_uses
	.p2align	2
	.type	pw_note_uses,@function
	.cc_top pw_note_uses.function,pw_note_uses
pw_note_uses:
	entsp 16
	stw r4, sp[15]
	stw r5, sp[14]
	stw r6, sp[13]
	stw r7, sp[12]
	stw r8, sp[11]
	stw r9, sp[10]
	stw r10, sp[9]
	mov r8, r3
	stw r2, sp[3]
	stw r0, sp[7]
	ldc r11, 0
	ld8u r0, r1[r11]
	eq r4, r0, 6
	eq r0, r0, 7
	ldc r2, 2
	stw r4, sp[2]
	bt r4, .LBB3_3
	bf r0, .LBB3_3
	ld8u r2, r1[r2]
	eq r2, r2, 1
	stw r2, sp[2]
.LBB3_3:
	stw r1, sp[1]
	ldc r1, 27692
	ldw r2, sp[7]
	add r1, r2, r1
	stw r1, sp[5]
	ldw r1, r1[0]
	stw r11, sp[6]
	bf r1, .LBB3_19
	ldw r1, sp[2]
	or r0, r1, r0
	stw r0, sp[4]
	ldc r0, 24244
	ldw r1, sp[7]
	add r10, r1, r0
	ldc r11, 0
	stw r11, sp[6]
	mov r9, r11
	bu .LBB3_5
.LBB3_18:
	mov r11, r5
	add r9, r9, 1
	ldw r0, sp[5]
	ldw r0, r0[0]
	add r10, r10, r4
	lsu r0, r9, r0
	bf r0, .LBB3_19
.LBB3_5:
	ld8u r0, r10[r11]
	sub r6, r10, 8
	bf r0, .LBB3_7
	ldw r0, sp[4]
	bt r0, .LBB3_8
	bu .LBB3_13
.LBB3_7:
	ldw r0, sp[2]
	bt r0, .LBB3_13
.LBB3_8:
	ldw r0, r6[1]
	eq r1, r0, r8
	bt r1, .LBB3_9
	lsu r0, r8, r0
	eq r0, r0, 0
	bf r0, .LBB3_12
	bu .LBB3_13
.LBB3_9:
	ldw r0, r6[0]
	ldw r1, sp[3]
	lsu r0, r1, r0
	eq r0, r0, 0
	bt r0, .LBB3_13
.LBB3_12:
	ldw r0, sp[3]
	stw r0, r6[0]
	stw r8, r6[1]
.LBB3_13:
	ldw r7, r6[0]
	ldw r4, r6[1]
	ldw r1, sp[7]
	ldw r0, r1[4]
	ldw r1, r1[5]
	ldc r2, 50
	mov r5, r11
	mov r3, r11
	bl __udivdi3
	eq r2, r4, r1
	bt r2, .LBB3_14
	lsu r0, r1, r4
	bu .LBB3_16
.LBB3_14:
	lsu r0, r0, r7
.LBB3_16:
	eq r0, r0, 0
	ldc r4, 48
	bt r0, .LBB3_18
	ldw r7, sp[6]
	ldc r0, 24236
	ldw r1, sp[7]
	lmul r1, r0, r7, r4, r1, r0
	mov r1, r6
	mov r2, r4
	bl __memcpy_4
	add r7, r7, 1
	stw r7, sp[6]
	bu .LBB3_18
.LBB3_19:
	ldw r0, sp[5]
	ldw r1, sp[6]
	stw r1, r0[0]
	ldw r10, sp[1]
	ldc r0, 0
	ld8u r0, r10[r0]
	ldc r2, 2
	or r0, r0, r2
	eq r0, r0, 6
	bf r0, .LBB3_26
	ldw r4, sp[18]
	ldw r7, sp[17]
	ldc r0, 48
	mul r0, r1, r0
	ldw r1, sp[7]
	add r8, r1, r0
	ldc r0, 24236
	add r9, r8, r0
	add r0, r9, 8
	ldc r6, 0
	ldc r2, 40
	stw r0, sp[4]
	mov r1, r6
	bl memset
	stw r4, r9[1]
	stw r7, r9[0]
	ld8u r0, r10[r6]
	eq r0, r0, 6
	ldc r1, 8
	st8 r0, r9[r1]
	ldaw r1, r10[4]
	mov r4, r1
	ld16s r1, r1[r6]
	ldc r2, 24246
	add r2, r8, r2
	st16 r1, r2[r6]
	ldc r1, 18
	add r10, r10, r1
	ld16s r1, r10[r6]
	ldaw r2, r9[3]
	st16 r1, r2[r6]
	ld16s r1, r10[r6]
	zext r1, 16
	bf r1, .LBB3_25
	bt r0, .LBB3_25
	ldc r0, 18604
	ldw r1, sp[7]
	add r0, r1, r0
	stw r0, sp[3]
	ldaw r9, sp[8]
	ldc r0, 24236
	add r5, r1, r0
	ldc r8, 14
	mov r7, r6
.LBB3_23:
	ld16s r0, r4[r6]
	zext r0, 16
	add r2, r7, r0
	mov r0, r9
	ldw r1, sp[3]
	bl pw_entry_get
	ld16s r0, r9[r6]
	ldc r1, 65528
	and r1, r0, r1
	zext r0, 3
	mkmsk r2, 1
	shl r0, r2, r0
	shr r1, r1, 3
	ldw r2, sp[6]
	ldc r3, 48
	lmul r1, r2, r2, r3, r5, r1
	ld8u r1, r2[r8]
	or r0, r1, r0
	st8 r0, r2[r8]
	add r7, r7, 1
	ld16s r0, r10[r6]
	zext r0, 16
	lsu r0, r7, r0
	bf r0, .LBB3_25
	ldw r0, sp[4]
	ld8u r0, r0[r6]
	bf r0, .LBB3_23
.LBB3_25:
	ldw r1, sp[5]
	ldw r0, r1[0]
	add r0, r0, 1
	stw r0, r1[0]
.LBB3_26:
	ldw r10, sp[9]
	ldw r9, sp[10]
	ldw r8, sp[11]
	ldw r7, sp[12]
	ldw r6, sp[13]
	ldw r5, sp[14]
	ldw r4, sp[15]
	retsp 16
	.cc_bottom pw_note_uses.function
.Lfunc_end3:
	.size	pw_note_uses, .Lfunc_end3-pw_note_uses

	.globl	pw_add_store
	.p2align	2
	.type	pw_add_store,@function
	.cc_top pw_add_store.function,pw_add_store
pw_add_store:
	entsp 128
	stw r4, sp[127]
	stw r5, sp[126]
	stw r6, sp[125]
	stw r7, sp[124]
	stw r8, sp[123]
	stw r9, sp[122]
	stw r10, sp[121]
	mov r5, r1
	mov r4, r0
	ldc r0, 28676
	add r0, r4, r0
	ldw r0, r0[0]
	ldc r1, 28680
	add r1, r4, r1
	ldw r2, r1[0]
	add r9, r2, r0
	zext r9, 1
	add r0, r2, 1
	stw r0, r1[0]
	ldc r6, 0
	ld8u r0, r5[r6]
	ldc r11, 27696
	ldc r3, 490
	lmul r1, r2, r9, r3, r4, r11
	st8 r0, r2[r6]
	ldaw r7, r5[4]
	ld16s r0, r7[r6]
	add r1, r2, 2
	st16 r0, r1[r6]
	ldc r0, 18
	add r8, r5, r0
	ld16s r0, r8[r6]
	add r1, r2, 4
	st16 r0, r1[r6]
	add r0, r2, 6
	st16 r6, r0[r6]
	add r0, r2, 8
	ldc r10, 10
	st16 r10, r0[r6]
	ld8u r1, r5[r6]
	eq r2, r1, 2
	bf r2, .LBB4_2
	ldw r0, r5[6]
	ldw r1, r4[1]
	ldw r1, r1[6]
	ldaw r6, sp[1]
	mov r2, r6
	mov r8, r11
	bl pw_pulses_sort
	add r0, r4, r8
	ldc r1, 490
	lmul r1, r0, r9, r1, r0, r10
	ldc r2, 480
	mov r1, r6
	bl memcpy
	ldw r0, r5[6]
	ldc r1, 320
	bl pw_pulses_power
	ldc r1, 0
	ld16s r1, r7[r1]
	zext r1, 16
	ldaw r1, r4[r1]
	ldc r2, 22700
	add r1, r1, r2
	stw r0, r1[0]
	bu .LBB4_9
.LBB4_2:
	eq r1, r1, 3
	bt r1, .LBB4_3
	ldc r1, 48
	bu .LBB4_5
.LBB4_3:
	ldc r1, 12
.LBB4_5:
	ld16s r2, r8[r6]
	zext r2, 16
	add r2, r1, r2
	sub r2, r2, 1
	divu r1, r2, r1
	mul r1, r1, r10
	st16 r1, r0[r6]
	add r0, r4, r11
	lmul r1, r0, r9, r3, r0, r10
	ldw r1, r5[6]
	ldc r2, 480
	bl memcpy
	ld8u r0, r5[r6]
	eq r0, r0, 3
	bf r0, .LBB4_6
	ldc r2, 0
	ld16s r0, r7[r2]
	zext r0, 16
	ldaw r0, r4[r0]
	ldc r1, 18604
	add r0, r0, r1
	ldw r1, r5[6]
	ld16s r2, r8[r2]
	zext r2, 16
	shl r2, r2, 2
	bl memcpy
	bu .LBB4_9
.LBB4_6:
	ld16s r0, r8[r6]
	zext r0, 16
	bf r0, .LBB4_9
	mkmsk r0, 1
	ldc r1, 23724
	mov r2, r6
.LBB4_8:
	ld16s r3, r7[r6]
	zext r3, 16
	add r3, r2, r3
	shr r11, r3, 3
	zext r3, 3
	shl r3, r0, r3
	add r11, r4, r11
	ld8u r5, r11[r1]
	or r3, r5, r3
	st8 r3, r11[r1]
	add r2, r2, 1
	ld16s r3, r8[r6]
	zext r3, 16
	lsu r3, r2, r3
	bt r3, .LBB4_8
.LBB4_9:
	ldw r10, sp[121]
	ldw r9, sp[122]
	ldw r8, sp[123]
	ldw r7, sp[124]
	ldw r6, sp[125]
	ldw r5, sp[126]
	ldw r4, sp[127]
	retsp 128
	.cc_bottom pw_add_store.function
.Lfunc_end4:
	.size	pw_add_store, .Lfunc_end4-pw_add_store

	.globl	pw_loads_left
	.p2align	2
	.type	pw_loads_left,@function
	.cc_top pw_loads_left.function,pw_loads_left
pw_loads_left:
	extsp 5
	stw r4, sp[4]
	stw r5, sp[3]
	stw r6, sp[2]
	stw r7, sp[1]
	stw r8, sp[0]
	ldc r1, 28680
	add r1, r0, r1
	ldw r2, r1[0]
	bf r2, .LBB5_1
	ldc r1, 28676
	add r1, r0, r1
	ldw r3, r1[0]
	ldc r11, 0
	ldc r4, 490
	ldc r5, 27704
	ldc r6, 27702
	mov r1, r11
.LBB5_4:
	mov r7, r3
	zext r7, 1
	mul r7, r7, r4
	add r7, r0, r7
	add r8, r7, r5
	ld16s r8, r8[r11]
	zext r8, 16
	add r7, r7, r6
	ld16s r7, r7[r11]
	zext r7, 16
	add r1, r1, r8
	sub r1, r1, r7
	sub r2, r2, 1
	add r3, r3, 1
	bt r2, .LBB5_4
	bu .LBB5_2
.LBB5_1:
	ldc r1, 0
.LBB5_2:
	mov r0, r1
	ldw r8, sp[0]
	ldw r7, sp[1]
	ldw r6, sp[2]
	ldw r5, sp[3]
	ldw r4, sp[4]
	ldaw sp, sp[5]
	retsp 0
	.cc_bottom pw_loads_left.function
.Lfunc_end5:
	.size	pw_loads_left, .Lfunc_end5-pw_loads_left

	.section	.cp.rodata.cst4,"aMc",@progbits,4
	.p2align	2
.LCPI6_0:
	.long	4294967236
	.text
	.globl	pw_send_loads
	.p2align	2
	.type	pw_send_loads,@function
	.cc_top pw_send_loads.function,pw_send_loads
pw_send_loads:
	entsp 47
	stw r4, sp[46]
	stw r5, sp[45]
	stw r6, sp[44]
	stw r7, sp[43]
	stw r8, sp[42]
	stw r9, sp[41]
	stw r10, sp[40]
	mov r5, r0
	ldc r0, 60
	lsu r0, r1, r0
	stw r1, sp[1]
	bt r0, .LBB6_17
	ldc r0, 28680
	add r0, r5, r0
	stw r0, sp[7]
	ldc r0, 28676
	add r0, r5, r0
	stw r0, sp[6]
	ldaw r0, sp[10]
	add r0, r0, 5
	stw r0, sp[3]
	ldc r7, 27696
	ldc r9, 490
	ldc r10, 0
	ldw r1, sp[1]
	stw r5, sp[4]
	bu .LBB6_2
.LBB6_16:
	ldw r0, cp[.LCPI6_0]
	ldw r1, sp[9]
	add r1, r1, r0
	ldc r0, 59
	lsu r0, r0, r1
	bf r0, .LBB6_17
.LBB6_2:
	ldw r0, sp[7]
	ldw r0, r0[0]
	bf r0, .LBB6_17
	stw r1, sp[9]
	ldw r0, sp[6]
	ldw r8, r0[0]
	lmul r0, r7, r8, r9, r5, r7
	add r0, r7, 6
	stw r0, sp[8]
	ld16s r0, r0[r10]
	mov r1, r0
	zext r1, 16
	ldc r2, 52429
	mul r1, r1, r2
	ldc r2, 19
	shr r2, r1, r2
	ldc r1, 10
	stw r2, sp[5]
	mul r1, r2, r1
	sub r6, r0, r1
	ldaw r4, sp[10]
	mov r0, r4
	mov r1, r10
	ldc r2, 54
	bl memset
	ld8u r0, r7[r10]
	eq r1, r0, 2
	bf r1, .LBB6_5
	mkmsk r0, 1
	mov r3, r0
	st8 r3, r4[r10]
	mul r0, r8, r9
	add r0, r5, r0
	ldc r2, 48
	mul r1, r6, r2
	ldc r11, 65520
	and r1, r1, r11
	add r1, r0, r1
	ldc r11, 27698
	add r0, r0, r11
	ld16s r0, r0[r10]
	ldc r11, 2
	or r11, r4, r11
	st16 r0, r11[r10]
	ldc r0, 4
	st8 r3, r4[r0]
	ldc r0, 27706
	add r1, r1, r0
	ldw r0, sp[3]
	bl memcpy
	ldc r7, 27696
	mov r1, r6
	bu .LBB6_14
.LBB6_5:
	stw r6, sp[2]
	eq r1, r0, 3
	ldc r0, 12
	bf r1, .LBB6_6
	ldc r2, 4
	bf r1, .LBB6_8
.LBB6_9:
	ldc r7, 2
	bt r1, .LBB6_11
.LBB6_10:
	mkmsk r7, 2
.LBB6_11:
	ldw r1, sp[5]
	mul r1, r0, r1
	mul r3, r8, r9
	ldw r11, sp[4]
	add r3, r11, r3
	ldc r11, 27700
	add r11, r3, r11
	ld16s r11, r11[r10]
	zext r11, 16
	sub r11, r11, r1
	st8 r7, r4[r10]
	ldc r5, 27698
	add r5, r3, r5
	ld16s r5, r5[r10]
	add r5, r5, r1
	ldc r7, 2
	or r7, r4, r7
	st16 r5, r7[r10]
	lsu r5, r11, r0
	bt r5, .LBB6_13
	mov r11, r0
.LBB6_13:
	ldc r7, 27696
	add r0, r3, r7
	ldc r3, 4
	st8 r11, r4[r3]
	ldc r3, 10
	lmul r0, r1, r1, r2, r0, r3
	mul r2, r11, r2
	ldw r0, sp[3]
	bl memcpy
	ldw r5, sp[4]
	ldw r1, sp[2]
.LBB6_14:
	zext r1, 16
	ldaw r4, sp[24]
	ldaw r2, sp[10]
	mov r0, r4
	bl pw_load_put
	mov r2, r0
	mov r0, r5
	mov r1, r4
	bl pw_send
	ldw r1, sp[8]
	ld16s r0, r1[r10]
	add r0, r0, 1
	st16 r0, r1[r10]
	zext r0, 16
	add r1, r5, r7
	ldc r2, 8
	lmul r1, r2, r8, r9, r1, r2
	ld16s r1, r2[r10]
	zext r1, 16
	eq r0, r0, r1
	bf r0, .LBB6_16
	ldw r2, sp[6]
	ldw r0, r2[0]
	mkmsk r1, 1
	andnot r1, r0
	stw r1, r2[0]
	ldw r1, sp[7]
	ldw r0, r1[0]
	sub r0, r0, 1
	stw r0, r1[0]
	bu .LBB6_16
.LBB6_6:
	ldc r0, 48
	ldc r2, 4
	bt r1, .LBB6_9
.LBB6_8:
	mkmsk r2, 1
	ldc r7, 2
	bf r1, .LBB6_10
	bu .LBB6_11
.LBB6_17:
	ldw r0, sp[1]
	sub r0, r0, r1
	ldw r10, sp[40]
	ldw r9, sp[41]
	ldw r8, sp[42]
	ldw r7, sp[43]
	ldw r6, sp[44]
	ldw r5, sp[45]
	ldw r4, sp[46]
	retsp 47
	.cc_bottom pw_send_loads.function
.Lfunc_end6:
	.size	pw_send_loads, .Lfunc_end6-pw_send_loads

	.ident	"Debian clang version 14.0.6"
	.section	".note.GNU-stack","",@progbits
