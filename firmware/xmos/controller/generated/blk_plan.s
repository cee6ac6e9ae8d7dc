# Made by clang from blk_plan.c; do not edit.
# sha256 of it and what it includes: ebea505c9053ce88e94ed68378b2bdeb59b9bf001e41716b5309a443d6a75f1e
	.text
	.section	.cp.rodata.cst4,"aMc",@progbits,4
	.p2align	2
.LCPI0_0:
	.long	954437177
	.text
	.globl	pw_change_at
	.p2align	2
	.type	pw_change_at,@function
	.cc_top pw_change_at.function,pw_change_at
pw_change_at:
	ldc r2, 18556
	add r2, r0, r2
	ldw r2, r2[0]
	add r1, r2, r1
	ldc r2, 0
	ldw r3, cp[.LCPI0_0]
	lmul r2, r3, r1, r3, r2, r2
	shr r2, r2, 3
	ldc r3, 36
	mul r2, r2, r3
	sub r1, r1, r2
	ldc r2, 9
	shl r1, r1, r2
	add r0, r0, r1
	ldc r1, 124
	add r0, r0, r1
	retsp 0
	.cc_bottom pw_change_at.function
.Lfunc_end0:
	.size	pw_change_at, .Lfunc_end0-pw_change_at

	.section	.cp.rodata.cst4,"aMc",@progbits,4
	.p2align	2
.LCPI1_0:
	.long	954437177
	.text
	.globl	pw_change_add
	.p2align	2
	.type	pw_change_add,@function
	.cc_top pw_change_add.function,pw_change_add
pw_change_add:
	entsp 5
	stw r4, sp[4]
	stw r5, sp[3]
	stw r6, sp[2]
	stw r7, sp[1]
	ldc r1, 18560
	add r5, r0, r1
	ldw r6, r5[0]
	ldc r1, 18556
	add r1, r0, r1
	ldw r1, r1[0]
	add r2, r1, r6
	ldc r1, 0
	ldw r3, cp[.LCPI1_0]
	lmul r3, r11, r2, r3, r1, r1
	shr r3, r3, 3
	ldc r11, 36
	mul r3, r3, r11
	sub r2, r2, r3
	ldc r3, 9
	shl r2, r2, r3
	add r7, r0, r2
	ldc r0, 124
	add r4, r7, r0
	ldc r2, 512
	mov r0, r4
	bl memset
	ldc r0, 132
	add r0, r7, r0
	mkmsk r1, 32
	stw r1, r0[1]
	stw r1, r0[0]
	add r0, r6, 1
	stw r0, r5[0]
	mov r0, r4
	ldw r7, sp[1]
	ldw r6, sp[2]
	ldw r5, sp[3]
	ldw r4, sp[4]
	retsp 5
	.cc_bottom pw_change_add.function
.Lfunc_end1:
	.size	pw_change_add, .Lfunc_end1-pw_change_add

	.section	.cp.rodata.cst4,"aMc",@progbits,4
	.p2align	2
.LCPI2_0:
	.long	954437177
.LCPI2_1:
	.long	4294948864
	.text
	.globl	pw_free_places
	.p2align	2
	.type	pw_free_places,@function
	.cc_top pw_free_places.function,pw_free_places
pw_free_places:
	extsp 7
	stw r4, sp[6]
	stw r5, sp[5]
	stw r6, sp[4]
	stw r7, sp[3]
	stw r8, sp[2]
	stw r9, sp[1]
	stw r10, sp[0]
	ldc r1, 28680
	add r1, r0, r1
	ldw r1, r1[0]
	eq r2, r1, 2
	ldc r1, 0
	bt r2, .LBB2_5
	ldc r2, 27692
	add r2, r0, r2
	ldw r2, r2[0]
	ldc r3, 72
	eq r2, r2, r3
	bt r2, .LBB2_5
	ldc r1, 18560
	add r1, r0, r1
	ldw r1, r1[0]
	bf r1, .LBB2_3
	ldc r2, 18556
	add r2, r0, r2
	ldw r2, r2[0]
	ldc r3, 9
	shl r3, r2, r3
	add r0, r0, r3
	ldc r3, 0
	ldw r11, cp[.LCPI2_0]
	ldw r4, cp[.LCPI2_1]
	ldc r5, 143
	mkmsk r8, 1
	ldc r9, 512
	mov r7, r3
	bu .LBB2_7
.LBB2_9:
	sub r1, r1, 1
	add r0, r0, r9
	add r2, r2, 1
	bf r1, .LBB2_4
.LBB2_7:
	lmul r10, r6, r2, r11, r3, r3
	shr r6, r10, 3
	mul r6, r6, r4
	add r10, r0, r6
	ld8u r6, r10[r5]
	bt r6, .LBB2_9
	ldc r6, 145
	ld8u r6, r10[r6]
	xor r6, r6, r8
	add r7, r7, r6
	bu .LBB2_9
.LBB2_3:
	ldc r7, 0
.LBB2_4:
	ldc r0, 32
	sub r1, r0, r7
.LBB2_5:
	zext r1, 8
	mov r0, r1
	ldw r10, sp[0]
	ldw r9, sp[1]
	ldw r8, sp[2]
	ldw r7, sp[3]
	ldw r6, sp[4]
	ldw r5, sp[5]
	ldw r4, sp[6]
	ldaw sp, sp[7]
	retsp 0
	.cc_bottom pw_free_places.function
.Lfunc_end2:
	.size	pw_free_places, .Lfunc_end2-pw_free_places

	.section	.cp.rodata.cst4,"aMc",@progbits,4
	.p2align	2
.LCPI3_0:
	.long	954437177
.LCPI3_1:
	.long	4294948864
	.text
	.globl	pw_device_has_room
	.p2align	2
	.type	pw_device_has_room,@function
	.cc_top pw_device_has_room.function,pw_device_has_room
pw_device_has_room:
	extsp 7
	stw r4, sp[6]
	stw r5, sp[5]
	stw r6, sp[4]
	stw r7, sp[3]
	stw r8, sp[2]
	stw r9, sp[1]
	stw r10, sp[0]
	ldc r1, 28680
	add r1, r0, r1
	ldw r1, r1[0]
	eq r2, r1, 2
	ldc r1, 0
	bt r2, .LBB3_5
	ldc r2, 27692
	add r2, r0, r2
	ldw r2, r2[0]
	ldc r3, 72
	eq r2, r2, r3
	bt r2, .LBB3_5
	ldc r1, 18560
	add r1, r0, r1
	ldw r1, r1[0]
	bf r1, .LBB3_3
	ldc r2, 18556
	add r2, r0, r2
	ldw r2, r2[0]
	ldc r3, 9
	shl r3, r2, r3
	add r0, r0, r3
	ldc r3, 0
	ldw r11, cp[.LCPI3_0]
	ldw r4, cp[.LCPI3_1]
	ldc r6, 143
	mkmsk r8, 1
	ldc r9, 512
	mov r5, r3
	bu .LBB3_7
.LBB3_9:
	sub r1, r1, 1
	add r0, r0, r9
	add r2, r2, 1
	bf r1, .LBB3_4
.LBB3_7:
	lmul r10, r7, r2, r11, r3, r3
	shr r7, r10, 3
	mul r7, r7, r4
	add r10, r0, r7
	ld8u r7, r10[r6]
	bt r7, .LBB3_9
	ldc r7, 145
	ld8u r7, r10[r7]
	xor r7, r7, r8
	add r5, r5, r7
	bu .LBB3_9
.LBB3_3:
	ldc r5, 0
.LBB3_4:
	zext r5, 8
	ldc r0, 32
	eq r0, r5, r0
	eq r1, r0, 0
.LBB3_5:
	mov r0, r1
	ldw r10, sp[0]
	ldw r9, sp[1]
	ldw r8, sp[2]
	ldw r7, sp[3]
	ldw r6, sp[4]
	ldw r5, sp[5]
	ldw r4, sp[6]
	ldaw sp, sp[7]
	retsp 0
	.cc_bottom pw_device_has_room.function
.Lfunc_end3:
	.size	pw_device_has_room, .Lfunc_end3-pw_device_has_room

	.globl	pw_has_slices
	.p2align	2
	.type	pw_has_slices,@function
	.cc_top pw_has_slices.function,pw_has_slices
pw_has_slices:
	eq r2, r0, 1
	bf r2, .LBB4_2
	mkmsk r0, 1
	retsp 0
.LBB4_2:
	eq r0, r0, 7
	eq r1, r1, 1
	eq r1, r1, 0
	and r0, r0, r1
	retsp 0
	.cc_bottom pw_has_slices.function
.Lfunc_end4:
	.size	pw_has_slices, .Lfunc_end4-pw_has_slices

	.section	.cp.rodata.cst4,"aMc",@progbits,4
	.p2align	2
.LCPI5_0:
	.long	954437177
.LCPI5_1:
	.long	4294948864
.LCPI5_2:
	.long	4294967227
.LCPI5_3:
	.long	2290649225
.LCPI5_4:
	.long	4294966046
	.text
	.globl	pw_first_period
	.p2align	2
	.type	pw_first_period,@function
	.cc_top pw_first_period.function,pw_first_period
pw_first_period:
	entsp 18
	stw r4, sp[17]
	stw r5, sp[16]
	stw r6, sp[15]
	stw r7, sp[14]
	stw r8, sp[13]
	stw r9, sp[12]
	stw r10, sp[11]
	mov r6, r1
	mov r4, r0
	ldw r1, r4[5]
	ldw r0, r4[4]
	ldc r9, 0
	ldc r2, 84
	ladd r2, r0, r0, r2, r9
	add r1, r1, r2
	ldc r2, 50
	mov r3, r9
	bl __udivdi3
	ldc r2, 2
	ladd r0, r3, r0, r2, r9
	add r2, r1, r0
	ldc r0, 253
	and r0, r6, r0
	eq r0, r0, 4
	bf r0, .LBB5_33
	stw r2, sp[2]
	stw r3, sp[1]
	mov r0, r4
	bl pw_loads_left
	mov r5, r0
	bf r5, .LBB5_2
	ldw r0, r4[4]
	ldw r1, r4[5]
	ldc r2, 50
	mov r3, r9
	bl __udivdi3
	stw r0, sp[10]
	stw r1, sp[9]
	ldc r2, 28688
	add r2, r4, r2
	ldw r11, r2[0]
	ldc r2, 18560
	add r2, r4, r2
	ldw r6, r2[0]
	ldc r2, 18556
	stw r4, sp[4]
	add r0, r4, r2
	stw r0, sp[3]
	stw r6, sp[7]
	bu .LBB5_4
.LBB5_25:
	sub r5, r5, r2
	bf r5, .LBB5_26
.LBB5_4:
	ldw r2, sp[9]
	ldw r3, sp[10]
	mkmsk r0, 1
	ladd r1, r0, r3, r0, r9
	stw r0, sp[10]
	add r0, r2, r1
	stw r0, sp[9]
	stw r5, sp[8]
	stw r2, sp[6]
	stw r3, sp[5]
	bf r6, .LBB5_17
	ldw r0, sp[3]
	ldw r7, r0[0]
	ldc r0, 9
	shl r2, r7, r0
	ldw r3, sp[4]
	add r2, r3, r2
	bu .LBB5_6
.LBB5_16:
	add r0, r5, r1
	add r11, r0, r3
	sub r6, r6, 1
	ldc r0, 512
	add r2, r2, r0
	add r7, r7, 1
	bf r6, .LBB5_17
.LBB5_6:
	mov r1, r11
	ldw r0, cp[.LCPI5_0]
	lmul r3, r4, r7, r0, r9, r9
	shr r3, r3, 3
	ldw r0, cp[.LCPI5_1]
	mul r3, r3, r0
	add r10, r2, r3
	ldc r0, 124
	add r3, r10, r0
	ldw r4, r3[1]
	ldw r3, r3[0]
	ldw r0, sp[10]
	lsub r5, r3, r3, r0, r9
	ldw r0, sp[9]
	lsub r4, r0, r4, r0, r5
	ldc r11, 140
	ld8u r5, r10[r11]
	eq r4, r5, 1
	bt r4, .LBB5_9
	eq r11, r5, 7
	mov r8, r9
	mov r5, r9
	bf r11, .LBB5_12
	ldc r11, 141
	ld8u r11, r10[r11]
	eq r11, r11, 1
	mov r8, r9
	mov r5, r9
	bt r11, .LBB5_12
.LBB5_9:
	ldc r11, 2
	xor r11, r3, r11
	or r11, r11, r0
	mov r10, r9
	mov r5, r9
	bt r11, .LBB5_11
	ldc r5, 520
.LBB5_11:
	ldc r8, 160
	mov r9, r10
.LBB5_12:
	mov r10, r9
	bt r4, .LBB5_14
	ldc r10, 250
.LBB5_14:
	mkmsk r11, 1
	xor r3, r3, r11
	or r11, r3, r0
	mov r3, r9
	bt r11, .LBB5_16
	add r3, r8, r10
	bu .LBB5_16
.LBB5_17:
	ldc r0, 69
	add r2, r11, r0
	ldc r0, 1251
	lsu r3, r0, r2
	bt r3, .LBB5_19
	ldc r2, 1251
.LBB5_19:
	sub r2, r2, r11
	ldw r0, cp[.LCPI5_2]
	add r2, r2, r0
	eq r3, r2, 0
	eq r3, r3, 0
	sub r2, r2, r3
	ldw r0, cp[.LCPI5_3]
	lmul r2, r4, r2, r0, r9, r9
	shr r2, r2, 5
	add r2, r2, r3
	ldw r5, sp[8]
	lsu r3, r2, r5
	ldw r6, sp[7]
	bt r3, .LBB5_21
	mov r2, r5
.LBB5_21:
	bt r5, .LBB5_23
	mov r2, r9
.LBB5_23:
	ldc r0, 9
	ldc r1, 60
	lmul r3, r11, r2, r1, r11, r0
	ldw r0, cp[.LCPI5_4]
	add r3, r11, r0
	lsu r4, r11, r3
	mov r11, r9
	bt r4, .LBB5_25
	mov r11, r3
	bu .LBB5_25
.LBB5_26:
	ldc r0, 0
	mkmsk r1, 2
	ldw r2, sp[5]
	ladd r0, r3, r2, r1, r0
	ldw r1, sp[6]
	add r2, r1, r0
	ldw r11, sp[2]
	eq r0, r11, r2
	ldw r4, sp[4]
	ldw r1, sp[1]
	bt r0, .LBB5_27
	lsu r0, r11, r2
	bf r0, .LBB5_30
	bu .LBB5_31
.LBB5_2:
	ldw r3, sp[1]
	ldw r2, sp[2]
	bu .LBB5_33
.LBB5_27:
	lsu r0, r1, r3
	bt r0, .LBB5_31
.LBB5_30:
	ldw r2, sp[2]
.LBB5_31:
	bt r0, .LBB5_33
	mov r3, r1
.LBB5_33:
	ldc r0, 18564
	add r0, r4, r0
	ldw r1, r0[1]
	ldw r0, r0[0]
	mkmsk r11, 1
	ladd r11, r0, r0, r11, r9
	add r1, r1, r11
	eq r11, r2, r1
	bt r11, .LBB5_34
	lsu r11, r2, r1
	bf r11, .LBB5_37
	bu .LBB5_38
.LBB5_34:
	lsu r11, r3, r0
	bt r11, .LBB5_38
.LBB5_37:
	mov r0, r3
.LBB5_38:
	bt r11, .LBB5_40
	mov r1, r2
.LBB5_40:
	ldw r10, sp[11]
	ldw r9, sp[12]
	ldw r8, sp[13]
	ldw r7, sp[14]
	ldw r6, sp[15]
	ldw r5, sp[16]
	ldw r4, sp[17]
	retsp 18
	.cc_bottom pw_first_period.function
.Lfunc_end5:
	.size	pw_first_period, .Lfunc_end5-pw_first_period

	.section	.cp.rodata.cst4,"aMc",@progbits,4
	.p2align	2
.LCPI6_0:
	.long	4294963200
.LCPI6_1:
	.long	954437177
.LCPI6_2:
	.long	4294967294
	.text
	.globl	pw_period_due
	.p2align	2
	.type	pw_period_due,@function
	.cc_top pw_period_due.function,pw_period_due
pw_period_due:
	entsp 6
	stw r4, sp[5]
	stw r5, sp[4]
	stw r6, sp[3]
	stw r7, sp[2]
	stw r8, sp[1]
	ldw r1, r0[7]
	ldw r3, r0[6]
	ldc r5, 0
	mkmsk r2, 1
	ladd r2, r4, r3, r2, r5
	ldc r11, 4096
	ladd r11, r3, r3, r11, r5
	add r7, r1, r11
	ldw r11, cp[.LCPI6_0]
	and r6, r3, r11
	ldc r3, 18596
	add r11, r0, r3
	ldw r3, r11[0]
	ldw r11, r11[1]
	eq r8, r11, r7
	bt r8, .LBB6_1
	lsu r8, r11, r7
	bf r8, .LBB6_4
	bu .LBB6_5
.LBB6_1:
	lsu r8, r3, r6
	bt r8, .LBB6_5
.LBB6_4:
	mov r11, r7
.LBB6_5:
	bt r8, .LBB6_7
	mov r3, r6
.LBB6_7:
	ldc r6, 18560
	add r6, r0, r6
	ldw r6, r6[0]
	bf r6, .LBB6_8
	ldc r6, 18556
	add r6, r0, r6
	ldw r6, r6[0]
	ldw r7, cp[.LCPI6_1]
	lmul r7, r8, r6, r7, r5, r5
	shr r7, r7, 3
	ldc r8, 36
	mul r7, r7, r8
	sub r6, r6, r7
	ldc r7, 9
	shl r6, r6, r7
	add r6, r0, r6
	ldc r7, 124
	add r6, r6, r7
	ldw r8, r6[1]
	ldw r6, r6[0]
	ldw r7, cp[.LCPI6_2]
	ladd r5, r7, r6, r7, r5
	mkmsk r6, 32
	ladd r5, r6, r8, r6, r5
	eq r5, r6, r11
	bt r5, .LBB6_10
	lsu r5, r6, r11
	bf r5, .LBB6_13
	bu .LBB6_14
.LBB6_8:
	mov r7, r3
	mov r6, r11
	bu .LBB6_16
.LBB6_10:
	lsu r5, r7, r3
	bt r5, .LBB6_14
.LBB6_13:
	mov r6, r11
.LBB6_14:
	bt r5, .LBB6_16
	mov r7, r3
.LBB6_16:
	add r5, r1, r2
	ldc r1, 28680
	add r1, r0, r1
	ldw r1, r1[0]
	bt r1, .LBB6_18
	bl pw_asks_for_playing
	bf r0, .LBB6_19
.LBB6_18:
	mov r7, r4
	mov r6, r5
.LBB6_19:
	eq r0, r6, r5
	bt r0, .LBB6_20
	lsu r0, r6, r5
	bf r0, .LBB6_23
	bu .LBB6_24
.LBB6_20:
	lsu r0, r7, r4
	bt r0, .LBB6_24
.LBB6_23:
	mov r4, r7
.LBB6_24:
	bt r0, .LBB6_26
	mov r5, r6
.LBB6_26:
	mov r0, r4
	mov r1, r5
	ldw r8, sp[1]
	ldw r7, sp[2]
	ldw r6, sp[3]
	ldw r5, sp[4]
	ldw r4, sp[5]
	retsp 6
	.cc_bottom pw_period_due.function
.Lfunc_end6:
	.size	pw_period_due, .Lfunc_end6-pw_period_due

	.section	.cp.rodata.cst4,"aMc",@progbits,4
	.p2align	2
.LCPI7_0:
	.long	954437177
.LCPI7_1:
	.long	4294966046
	.text
	.globl	pw_work_on_period
	.p2align	2
	.type	pw_work_on_period,@function
	.cc_top pw_work_on_period.function,pw_work_on_period
pw_work_on_period:
	entsp 37
	stw r4, sp[36]
	stw r5, sp[35]
	stw r6, sp[34]
	stw r7, sp[33]
	stw r8, sp[32]
	stw r9, sp[31]
	stw r10, sp[30]
	mov r7, r2
	mov r4, r0
	stw r7, r4[7]
	stw r1, r4[6]
	ldc r0, 4095
	stw r1, sp[9]
	and r0, r1, r0
	bt r0, .LBB7_2
	ldw r0, r4[0]
	ldw r1, r0[3]
	ldw r0, r0[0]
	bla r1
	stw r7, r4[9]
	ldw r0, sp[9]
	stw r0, r4[8]
	ldw r0, r4[10]
	add r0, r0, 1
	stw r0, r4[10]
.LBB7_2:
	ldc r0, 18560
	add r0, r4, r0
	stw r0, sp[10]
	ldw r0, r0[0]
	ldc r1, 18556
	ldc r3, 0
	ldc r11, 36
	ldc r10, 9
	ldc r5, 124
	stw r7, sp[8]
	bf r0, .LBB7_3
	add r1, r4, r1
	ldw r1, r1[0]
	ldw r2, cp[.LCPI7_0]
	lmul r2, r3, r1, r2, r3, r3
	shr r2, r2, 3
	mul r2, r2, r11
	sub r2, r1, r2
	shl r3, r2, r10
	add r3, r4, r3
	add r11, r3, r5
	ldw r5, r11[0]
	ldw r11, r11[1]
	xor r11, r11, r7
	ldw r10, sp[9]
	xor r5, r5, r10
	or r9, r5, r11
	eq r8, r9, 0
	ldc r11, 18596
	add r6, r4, r11
	ldw r11, r6[0]
	ldw r5, r6[1]
	xor r5, r5, r7
	xor r11, r11, r10
	or r11, r11, r5
	bt r11, .LBB7_15
	bt r9, .LBB7_15
	ldc r11, 140
	ld8u r11, r3[r11]
	eq r5, r11, 6
	bt r5, .LBB7_8
	eq r11, r11, 7
	ldc r10, 9
	bf r11, .LBB7_10
	ldc r11, 141
	ld8u r11, r3[r11]
	eq r11, r11, 1
	eq r11, r11, 0
	bu .LBB7_12
.LBB7_3:
	ldc r0, 18596
	add r6, r4, r0
	ldw r0, r6[0]
	ldw r1, r6[1]
	xor r1, r1, r7
	ldw r2, sp[9]
	xor r0, r0, r2
	or r0, r0, r1
	bt r0, .LBB7_33
	ldc r8, 0
	bu .LBB7_16
.LBB7_15:
	ldc r10, 9
	bt r11, .LBB7_14
	bu .LBB7_16
.LBB7_8:
	ldc r10, 9
	bu .LBB7_16
.LBB7_10:
	mkmsk r11, 1
.LBB7_12:
	ldc r5, 145
	ld8u r3, r3[r5]
	bt r3, .LBB7_16
	bf r11, .LBB7_16
.LBB7_14:
	ldw r11, sp[9]
	ldw r5, sp[8]
	ldc r3, 0
	bf r9, .LBB7_18
	bu .LBB7_33
.LBB7_16:
	ldc r0, 18584
	add r0, r4, r0
	ldc r5, 0
	st16 r5, r0[r5]
	ldc r0, 18588
	add r0, r4, r0
	stw r5, r0[1]
	stw r5, r0[0]
	mkmsk r0, 32
	stw r0, r6[1]
	stw r0, r6[0]
	ldc r1, 4
	mkmsk r2, 8
	mov r0, r4
	bl pw_event
	bf r8, .LBB7_32
	ldc r0, 18556
	add r0, r4, r0
	ldw r1, r0[0]
	ldw r0, sp[10]
	ldw r0, r0[0]
	ldw r2, cp[.LCPI7_0]
	lmul r2, r3, r1, r2, r5, r5
	shr r2, r2, 3
	ldc r3, 36
	mul r2, r2, r3
	sub r2, r1, r2
	shl r3, r2, r10
	add r3, r4, r3
	ldc r11, 124
	add r3, r3, r11
	ldw r5, r3[1]
	ldw r11, r3[0]
	mkmsk r3, 1
.LBB7_18:
	stw r5, sp[5]
	stw r11, sp[6]
	stw r3, sp[13]
	ldc r3, 18556
	add r3, r4, r3
	shl r2, r2, r10
	add r2, r4, r2
	ldc r5, 132
	add r5, r2, r5
	ldw r11, r5[1]
	stw r11, sp[12]
	ldw r11, r5[0]
	stw r11, sp[11]
	ldc r5, 140
	ld8u r8, r2[r5]
	ldc r5, 141
	ld8u r11, r2[r5]
	stw r11, sp[7]
	ldc r5, 142
	ld8u r5, r2[r5]
	ldc r11, 145
	ld8u r11, r2[r11]
	ldc r9, 146
	ld8u r2, r2[r9]
	add r1, r1, 1
	ldw r9, cp[.LCPI7_0]
	ldc r7, 0
	lmul r9, r10, r1, r9, r7, r7
	ldc r10, 9
	shr r9, r9, 3
	ldc r7, 36
	mul r9, r9, r7
	sub r1, r1, r9
	stw r1, r3[0]
	sub r0, r0, 1
	ldw r1, sp[10]
	stw r0, r1[0]
	bf r11, .LBB7_19
.LBB7_31:
	ldw r0, sp[13]
	bf r0, .LBB7_33
.LBB7_32:
	mkmsk r1, 8
	mov r0, r4
	bl pw_tell
.LBB7_33:
	ldc r0, 28688
	add r1, r4, r0
	ldw r2, r1[0]
	ldw r0, sp[10]
	ldw r0, r0[0]
	stw r1, sp[2]
	stw r2, sp[11]
	bf r0, .LBB7_38
	ldc r0, 18556
	add r0, r4, r0
	stw r0, sp[7]
	ldc r0, 28692
	add r0, r4, r0
	stw r0, sp[6]
	ldc r0, 28684
	add r0, r4, r0
	stw r0, sp[4]
	ldc r0, 28685
	add r0, r4, r0
	stw r0, sp[3]
	ldc r0, 156
	add r0, r4, r0
	stw r0, sp[5]
	ldc r8, 0
	mkmsk r7, 1
	mov r1, r7
	mov r9, r8
	bu .LBB7_35
.LBB7_37:
	ldc r10, 9
.LBB7_67:
	ldw r2, sp[13]
.LBB7_68:
	add r0, r9, 1
	ldw r1, sp[10]
	ldw r1, r1[0]
	lsu r0, r0, r1
	and r0, r2, r0
	mov r1, r8
	mov r9, r7
	bf r0, .LBB7_38
.LBB7_35:
	stw r1, sp[13]
	ldw r0, sp[7]
	ldw r0, r0[0]
	add r0, r0, r9
	ldw r1, cp[.LCPI7_0]
	lmul r1, r2, r0, r1, r8, r8
	shr r1, r1, 3
	ldc r2, 36
	mul r1, r1, r2
	sub r0, r0, r1
	shl r3, r0, r10
	add r6, r4, r3
	ldc r0, 124
	add r10, r6, r0
	ldw r2, r10[1]
	ldw r1, r10[0]
	ldw r0, sp[9]
	lsub r11, r0, r1, r0, r8
	ldw r5, sp[8]
	lsub r5, r11, r2, r5, r11
	ldaw r5, r10[4]
	stw r5, sp[12]
	ldc r5, 2
	xor r5, r0, r5
	or r5, r5, r11
	bf r5, .LBB7_63
	xor r0, r0, r7
	or r0, r0, r11
	bt r0, .LBB7_37
	ldw r0, sp[12]
	ld8u r0, r0[r8]
	eq r11, r0, 1
	bt r11, .LBB7_47
	eq r11, r0, 7
	bf r11, .LBB7_45
	ldc r11, 141
	ld8u r11, r6[r11]
	eq r11, r11, 1
	mov r5, r8
	bt r11, .LBB7_51
.LBB7_47:
	ldw r0, sp[5]
	add r7, r0, r3
.LBB7_48:
	mov r0, r7
	bl pw_commit_checksum
	ldw r3, r10[1]
	ldw r2, r10[0]
	stw r0, sp[1]
	mov r1, r8
	zext r1, 16
	ldaw r5, sp[14]
	mov r0, r5
	bl pw_commit_put
	mov r2, r0
	mov r0, r4
	mov r1, r5
	bl pw_send
	eq r0, r8, 9
	bt r0, .LBB7_50
	ldw r2, r10[1]
	ldw r1, r10[0]
	ldc r0, 48
	add r7, r7, r0
	add r8, r8, 1
	bu .LBB7_48
.LBB7_63:
	ldw r0, sp[12]
	ld8u r0, r0[r8]
	eq r1, r0, 1
	ldc r10, 9
	bt r1, .LBB7_66
	eq r0, r0, 7
	bf r0, .LBB7_67
	ldc r0, 141
	ld8u r0, r6[r0]
	eq r0, r0, 1
	bt r0, .LBB7_67
.LBB7_66:
	ldc r0, 156
	add r2, r6, r0
	ldaw r7, sp[14]
	mov r0, r7
	mov r1, r8
	bl pw_slice_put
	mov r2, r0
	mov r0, r4
	mov r1, r7
	bl pw_send
	ldc r0, 204
	add r2, r6, r0
	mov r0, r7
	mkmsk r1, 1
	bl pw_slice_put
	mov r2, r0
	mov r0, r4
	mov r1, r7
	bl pw_send
	ldc r0, 252
	add r2, r6, r0
	mov r0, r7
	ldc r1, 2
	bl pw_slice_put
	mov r2, r0
	mov r0, r4
	mov r1, r7
	bl pw_send
	ldc r0, 300
	add r2, r6, r0
	mov r0, r7
	mkmsk r1, 2
	bl pw_slice_put
	mov r2, r0
	mov r0, r4
	mov r1, r7
	bl pw_send
	ldc r0, 348
	add r2, r6, r0
	mov r0, r7
	ldc r1, 4
	bl pw_slice_put
	mov r2, r0
	mov r0, r4
	mov r1, r7
	bl pw_send
	ldc r0, 396
	add r2, r6, r0
	mov r0, r7
	ldc r1, 5
	bl pw_slice_put
	mov r2, r0
	mov r0, r4
	mov r1, r7
	bl pw_send
	ldc r0, 444
	add r2, r6, r0
	mov r0, r7
	ldc r1, 6
	bl pw_slice_put
	mov r2, r0
	mov r0, r4
	mov r1, r7
	bl pw_send
	ldc r0, 492
	add r2, r6, r0
	mov r0, r7
	mkmsk r1, 3
	bl pw_slice_put
	mov r2, r0
	mov r0, r4
	mov r1, r7
	bl pw_send
	ldc r0, 540
	add r2, r6, r0
	mov r0, r7
	ldc r1, 8
	bl pw_slice_put
	mov r2, r0
	mov r0, r4
	mov r1, r7
	bl pw_send
	ldc r0, 588
	add r2, r6, r0
	mov r0, r7
	mov r1, r10
	bl pw_slice_put
	mov r2, r0
	mov r0, r4
	mov r1, r7
	mkmsk r7, 1
	bl pw_send
	ldc r0, 143
	st8 r7, r6[r0]
	ldw r0, sp[11]
	ldc r1, 520
	add r0, r0, r1
	stw r0, sp[11]
	bu .LBB7_67
.LBB7_50:
	ldw r1, sp[6]
	ldw r0, r1[0]
	add r0, r0, 1
	stw r0, r1[0]
	ldc r8, 0
	ldw r0, sp[12]
	ld8u r0, r0[r8]
	ldc r5, 160
	mkmsk r7, 1
.LBB7_51:
	eq r1, r0, 1
	bt r1, .LBB7_61
.LBB7_52:
	eq r1, r0, 7
	bf r1, .LBB7_56
	ldw r7, sp[4]
	ld8u r0, r7[r8]
	ldw r1, sp[3]
	st8 r0, r1[r8]
	bf r0, .LBB7_54
	ldaw r1, sp[14]
	mkmsk r0, 2
	st8 r0, r1[r8]
	ldc r0, 2
	or r0, r1, r0
	st16 r8, r0[r8]
	stw r8, sp[15]
	ldaw r0, sp[16]
	st16 r8, r0[r8]
	ldw r0, r10[0]
	ldw r2, r10[1]
	stw r2, sp[18]
	stw r0, sp[17]
	mov r0, r4
	bl send_programs
	ldc r0, 250
	add r5, r5, r0
	st8 r8, r7[r8]
.LBB7_54:
	ldc r10, 9
	mkmsk r7, 1
	bu .LBB7_62
.LBB7_56:
	stw r8, sp[14]
	stw r8, sp[16]
	stw r8, sp[15]
	eq r1, r0, 4
	ldc r0, 2
	bt r1, .LBB7_58
	mkmsk r0, 2
.LBB7_58:
	ldaw r2, sp[16]
	ldaw r3, sp[15]
	ldaw r1, sp[14]
	st8 r0, r1[r8]
	ldc r0, 148
	add r0, r6, r0
	ld16s r0, r0[r8]
	ldc r11, 2
	or r11, r1, r11
	st16 r0, r11[r8]
	ldc r0, 150
	add r0, r6, r0
	ld16s r0, r0[r8]
	st16 r0, r3[r8]
	ldc r0, 152
	add r0, r6, r0
	ld16s r0, r0[r8]
	add r3, r1, 6
	st16 r0, r3[r8]
	ldc r0, 154
	add r0, r6, r0
	ld16s r0, r0[r8]
	st16 r0, r2[r8]
	ldw r0, r10[0]
	ldw r2, r10[1]
	stw r2, sp[18]
	stw r0, sp[17]
	mov r0, r4
	bl send_programs
	ldw r2, sp[4]
	ld8u r1, r2[r8]
	mov r0, r7
	bt r1, .LBB7_60
	ldw r0, sp[12]
	ld8u r0, r0[r8]
	eq r0, r0, 6
.LBB7_60:
	ldc r1, 250
	add r5, r5, r1
	st8 r0, r2[r8]
.LBB7_61:
	ldc r10, 9
.LBB7_62:
	ldw r2, sp[13]
	ldc r0, 143
	st8 r7, r6[r0]
	ldc r0, 144
	st8 r7, r6[r0]
	ldw r0, sp[11]
	add r0, r5, r0
	stw r0, sp[11]
	bu .LBB7_68
.LBB7_45:
	mov r5, r8
	eq r1, r0, 1
	bf r1, .LBB7_52
	bu .LBB7_61
.LBB7_38:
	ldw r5, sp[11]
	add r0, r5, 9
	ldc r1, 1251
	lsu r0, r0, r1
	bf r0, .LBB7_40
	ldc r1, 9
	mov r0, r4
	bl pw_ask_for_playing
	add r5, r0, r5
	ldc r6, 1250
	sub r1, r6, r5
	mov r0, r4
	bl pw_send_loads
	add r5, r5, r0
	sub r1, r6, r5
	mov r0, r4
	bl pw_ask_for_playing
	add r5, r5, r0
.LBB7_40:
	ldw r0, cp[.LCPI7_1]
	add r0, r5, r0
	lsu r1, r5, r0
	bf r1, .LBB7_42
	ldc r0, 0
.LBB7_42:
	ldw r1, sp[2]
	stw r0, r1[0]
	ldw r10, sp[30]
	ldw r9, sp[31]
	ldw r8, sp[32]
	ldw r7, sp[33]
	ldw r6, sp[34]
	ldw r5, sp[35]
	ldw r4, sp[36]
	retsp 37
.LBB7_19:
	ldw r7, sp[7]
	eq r0, r8, 1
	ldw r3, sp[11]
	ldw r11, sp[12]
	bt r0, .LBB7_22
	eq r0, r8, 6
	bt r0, .LBB7_30
	eq r0, r8, 4
	bf r0, .LBB7_25
.LBB7_22:
	ldc r0, 18584
	mkmsk r1, 1
	st8 r1, r4[r0]
	eq r0, r8, 4
	ldc r1, 18585
	st8 r0, r4[r1]
	ldc r0, 18588
	add r0, r4, r0
	ldw r1, sp[5]
	stw r1, r0[1]
	ldw r1, sp[6]
	stw r1, r0[0]
	stw r11, r6[1]
	stw r3, r6[0]
	ldc r1, 2
	and r0, r5, r1
	bf r0, .LBB7_24
	mkmsk r1, 2
.LBB7_24:
	ldw r5, sp[13]
	mov r0, r4
	bl pw_event
	bt r5, .LBB7_32
	bu .LBB7_33
.LBB7_30:
	ldc r0, 18586
	mkmsk r1, 1
	st8 r1, r4[r0]
	bu .LBB7_31
.LBB7_25:
	ldc r1, 18586
	ldc r0, 0
	st8 r0, r4[r1]
	eq r1, r7, 3
	bt r1, .LBB7_29
	eq r1, r7, 2
	bf r1, .LBB7_31
	ldc r1, 18584
	add r1, r4, r1
	st16 r0, r1[r0]
	ldc r1, 18588
	add r1, r4, r1
	stw r0, r1[1]
	stw r0, r1[0]
	mkmsk r0, 32
	stw r0, r6[1]
	stw r0, r6[0]
	ldc r1, 4
	bu .LBB7_28
.LBB7_29:
	ldc r1, 18584
	add r1, r4, r1
	st16 r0, r1[r0]
	ldc r1, 18588
	add r1, r4, r1
	stw r0, r1[1]
	stw r0, r1[0]
	mkmsk r0, 32
	stw r0, r6[1]
	stw r0, r6[0]
	mkmsk r1, 1
.LBB7_28:
	mov r0, r4
	bl pw_event
	bu .LBB7_31
	.cc_bottom pw_work_on_period.function
.Lfunc_end7:
	.size	pw_work_on_period, .Lfunc_end7-pw_work_on_period

	.p2align	2
	.type	send_programs,@function
	.cc_top send_programs.function,send_programs
send_programs:
	entsp 20
	stw r4, sp[19]
	stw r5, sp[18]
	stw r6, sp[17]
	mov r6, r1
	mov r4, r0
	ldaw r5, sp[1]
	ldc r1, 0
	mov r0, r5
	mov r2, r6
	bl pw_program_put
	mov r2, r0
	mov r0, r4
	mov r1, r5
	bl pw_send
	mkmsk r1, 1
	mov r0, r5
	mov r2, r6
	bl pw_program_put
	mov r2, r0
	mov r0, r4
	mov r1, r5
	bl pw_send
	ldc r1, 2
	mov r0, r5
	mov r2, r6
	bl pw_program_put
	mov r2, r0
	mov r0, r4
	mov r1, r5
	bl pw_send
	mkmsk r1, 2
	mov r0, r5
	mov r2, r6
	bl pw_program_put
	mov r2, r0
	mov r0, r4
	mov r1, r5
	bl pw_send
	ldc r1, 4
	mov r0, r5
	mov r2, r6
	bl pw_program_put
	mov r2, r0
	mov r0, r4
	mov r1, r5
	bl pw_send
	ldc r1, 5
	mov r0, r5
	mov r2, r6
	bl pw_program_put
	mov r2, r0
	mov r0, r4
	mov r1, r5
	bl pw_send
	ldc r1, 6
	mov r0, r5
	mov r2, r6
	bl pw_program_put
	mov r2, r0
	mov r0, r4
	mov r1, r5
	bl pw_send
	mkmsk r1, 3
	mov r0, r5
	mov r2, r6
	bl pw_program_put
	mov r2, r0
	mov r0, r4
	mov r1, r5
	bl pw_send
	ldc r1, 8
	mov r0, r5
	mov r2, r6
	bl pw_program_put
	mov r2, r0
	mov r0, r4
	mov r1, r5
	bl pw_send
	ldc r1, 9
	mov r0, r5
	mov r2, r6
	bl pw_program_put
	mov r2, r0
	mov r0, r4
	mov r1, r5
	bl pw_send
	ldw r6, sp[17]
	ldw r5, sp[18]
	ldw r4, sp[19]
	retsp 20
	.cc_bottom send_programs.function
.Lfunc_end8:
	.size	send_programs, .Lfunc_end8-send_programs

	.ident	"Debian clang version 14.0.6"
	.section	".note.GNU-stack","",@progbits
