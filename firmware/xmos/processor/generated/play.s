# Made by clang from play.c; do not edit.
# sha256 of it and what it includes: ee951b01586439414666baeecadf10a158b68b0929d272187dbc768fdcc836ac
	.text
	.section	.cp.rodata.cst4,"aMc",@progbits,4
	.p2align	2
.LCPI0_0:
	.long	1426063360
	.text
	.globl	play_begin
	.p2align	2
	.type	play_begin,@function
	.cc_top play_begin.function,play_begin
play_begin:
	entsp 1
	ldaw r11, cp[silence]
	stw r11, dp[now_plays.1]
	stw r11, dp[told+8]
	stw r11, dp[told+24]
	mkmsk r0, 1
	stw r0, dp[told+64]
	ldw r0, dp[temperature_port]
	peek r0, res[r0]
	zext r0, 8
	stw r0, dp[told+60]
	ldaw r1, dp[silent_table]
	stw r1, dp[next_table]
	ldaw r1, dp[tables]
	stw r1, dp[table]
	shl r1, r0, 24
	ldw r2, dp[temperature_port]
	setd res[r2], r0
	stw r0, dp[told+60]
	ldw r0, cp[.LCPI0_0]
	lss r1, r0, r1
	ldc r0, 8
	bl set_fault
	ldw r0, dp[supply_port]
	peek r0, res[r0]
	ldw r1, dp[supply_port]
	zext r0, 1
	setd res[r1], r0
	eq r1, r0, 0
	ldc r0, 16
	bl set_fault
	retsp 1
	.cc_bottom play_begin.function
.Lfunc_end0:
	.size	play_begin, .Lfunc_end0-play_begin

	.section	.cp.rodata.cst4,"aMc",@progbits,4
	.p2align	2
.LCPI1_0:
	.long	1426063360
	.text
	.globl	play_temperature
	.p2align	2
	.type	play_temperature,@function
	.cc_top play_temperature.function,play_temperature
play_temperature:
	entsp 1
	shl r1, r0, 24
	ldw r2, dp[temperature_port]
	zext r0, 8
	setd res[r2], r0
	stw r0, dp[told+60]
	ldw r0, cp[.LCPI1_0]
	lss r1, r0, r1
	ldc r0, 8
	bl set_fault
	retsp 1
	.cc_bottom play_temperature.function
.Lfunc_end1:
	.size	play_temperature, .Lfunc_end1-play_temperature

	.globl	play_supply
	.p2align	2
	.type	play_supply,@function
	.cc_top play_supply.function,play_supply
play_supply:
	entsp 1
	ldw r1, dp[supply_port]
	zext r0, 1
	setd res[r1], r0
	eq r1, r0, 0
	ldc r0, 16
	bl set_fault
	retsp 1
	.cc_bottom play_supply.function
.Lfunc_end2:
	.size	play_supply, .Lfunc_end2-play_supply

	.p2align	2
	.type	set_fault,@function
	.cc_top set_fault.function,set_fault
set_fault:
	entsp 1
	ldw r2, dp[told+52]
	ldw r3, dp[state_lock]
	in r3, res[r3]
	ldw r3, dp[told+52]
	bt r1, .LBB3_1
	andnot r3, r0
	bu .LBB3_3
.LBB3_1:
	or r3, r3, r0
.LBB3_3:
	stw r3, dp[told+52]
	ldw r3, dp[state_lock]
	out res[r3], r3
	bf r1, .LBB3_6
	and r0, r2, r0
	bt r0, .LBB3_6
	bl fall_silent
.LBB3_6:
	retsp 1
	.cc_bottom set_fault.function
.Lfunc_end3:
	.size	set_fault, .Lfunc_end3-set_fault

	.globl	play_started
	.p2align	2
	.type	play_started,@function
	.cc_top play_started.function,play_started
play_started:
	entsp 1
	ldw r0, dp[first_time]
	stw r0, dp[heard]
	ldw r1, dp[first_stamp]
	stw r1, dp[sync_stamp]
	stw r0, dp[boundary]
	ldc r1, 0
	ldaw r2, dp[sync_came]
	mkmsk r3, 1
	st8 r3, r2[r1]
	stw r3, dp[time_runs]
	stw r0, dp[told+32]
	ldc r1, 1426
	add r0, r0, r1
	stw r0, dp[decide_at]
	ldw r0, dp[sync_port]
	setd res[r0], r3
	ldw r0, dp[unsynced]
	bf r0, .LBB4_2
	ldc r0, 4
	mkmsk r1, 1
	bl set_fault
.LBB4_2:
	retsp 1
	.cc_bottom play_started.function
.Lfunc_end4:
	.size	play_started, .Lfunc_end4-play_started

	.section	.cp.rodata.cst4,"aMc",@progbits,4
	.p2align	2
.LCPI5_0:
	.long	3221225472
.LCPI5_1:
	.long	204825
.LCPI5_2:
	.long	1374389535
.LCPI5_3:
	.long	4294963200
.LCPI5_4:
	.long	4294960921
.LCPI5_5:
	.long	4294967168
.LCPI5_6:
	.long	4294967292
	.text
	.globl	play_sync
	.p2align	2
	.type	play_sync,@function
	.cc_top play_sync.function,play_sync
play_sync:
	entsp 1
	ldw r0, dp[sync_port]
	getts r1, res[r0]
	ldw r0, dp[sync_port]
	in r0, res[r0]
	ldw r0, dp[sync_port]
	edu res[r0]
	ldc r0, 0
	ldaw r2, dp[sync_came]
	mkmsk r3, 1
	st8 r3, r2[r0]
	ldw r2, dp[sync_stamp]
	sub r2, r1, r2
	shl r2, r2, 16
	ldw r3, cp[.LCPI5_0]
	add r2, r2, r3
	ashr r2, r2, 16
	ldw r3, dp[sync_offset]
	add r2, r2, r3
	stw r2, dp[sync_offset]
	stw r1, dp[sync_stamp]
	bf r2, .LBB5_1
	ldw r1, cp[.LCPI5_1]
	add r1, r2, r1
	ldw r3, cp[.LCPI5_2]
	mov r11, r0
	maccs r0, r11, r1, r3
	mkmsk r1, 5
	shr r1, r0, r1
	ashr r0, r0, 4
	add r0, r0, r1
	ldw r1, cp[.LCPI5_3]
	add r1, r0, r1
	ldw r0, dp[state_lock]
	in r0, res[r0]
	ldc r0, 6324
	lss r0, r0, r2
	bt r0, .LBB5_3
	ldw r0, cp[.LCPI5_4]
	lss r0, r2, r0
	bt r0, .LBB5_9
	mov r0, r1
	bu .LBB5_6
.LBB5_1:
	ldw r1, dp[state_lock]
	in r1, res[r1]
	mov r1, r0
	bu .LBB5_6
.LBB5_3:
	mkmsk r0, 7
	bu .LBB5_6
.LBB5_9:
	ldw r0, cp[.LCPI5_5]
.LBB5_6:
	stw r0, dp[told+56]
	ldw r0, dp[state_lock]
	out res[r0], r0
	sub r0, r1, 2
	ldw r1, cp[.LCPI5_6]
	lsu r0, r1, r0
	bt r0, .LBB5_8
	ldc r0, 4
	mkmsk r1, 1
	bl set_fault
.LBB5_8:
	retsp 1
	.cc_bottom play_sync.function
.Lfunc_end5:
	.size	play_sync, .Lfunc_end5-play_sync

	.section	.cp.rodata.cst4,"aMc",@progbits,4
	.p2align	2
.LCPI6_0:
	.long	3988292384
	.text
	.globl	play_message
	.p2align	2
	.type	play_message,@function
	.cc_top play_message.function,play_message
play_message:
	entsp 3
	stw r4, sp[2]
	stw r5, sp[1]
	mov r4, r0
	ldw r0, dp[number]
	mkmsk r1, 16
	eq r0, r0, r1
	bf r0, .LBB6_2
	bl damaged
	bu .LBB6_23
.LBB6_2:
	ldc r0, 56
	add r0, r4, r0
	ldw r0, r0[0]
	eq r1, r0, 2
	bt r1, .LBB6_5
	eq r0, r0, 1
	bf r0, .LBB6_22
	ldw r0, dp[mail_place]
	ldc r5, 48
	mul r0, r0, r5
	ldaw r1, dp[pool]
	add r0, r0, r1
	mov r1, r4
	bl slice_copy
	add r0, r4, r5
	ldw r0, r0[0]
	stw r0, dp[mail_crc]
	ldc r0, 0
	ldaw r1, dp[has_mail]
	mkmsk r2, 1
	st8 r2, r1[r0]
	bu .LBB6_23
.LBB6_5:
	ldw r0, r4[1]
	ldw r1, r4[0]
	ldw r2, dp[mail_crc]
	ldw r11, r4[2]
	ldaw r4, dp[has_mail]
	ldc r3, 0
	ld8u r5, r4[r3]
	st8 r3, r4[r3]
	bf r5, .LBB6_17
	ldw r4, cp[.LCPI6_0]
	crc32 r2, r1, r4
	crc32 r2, r0, r4
	crc32 r2, r11, r4
	mkmsk r11, 32
	eq r2, r2, r11
	bf r2, .LBB6_17
	ldw r2, dp[began]
	bf r2, .LBB6_11
	ldw r2, dp[play_clock]
	in r2, res[r2]
	ldw r3, dp[boundary]
	sub r2, r2, r3
	ashr r2, r2, 32
	bt r2, .LBB6_9
	ldc r3, 0
	stw r3, dp[began]
	bu .LBB6_11
.LBB6_22:
	mov r0, r4
	bl take_program
	bu .LBB6_23
.LBB6_9:
	ldw r3, dp[began]
.LBB6_11:
	ldw r2, dp[waiting]
	or r3, r2, r3
	zext r3, 1
	bt r3, .LBB6_17
	ldw r3, dp[time_runs]
	bf r3, .LBB6_17
	ldw r3, dp[decided+4]
	eq r11, r3, r0
	bt r11, .LBB6_14
	lsu r3, r3, r0
	bu .LBB6_16
.LBB6_14:
	ldw r3, dp[decided]
	lsu r3, r3, r1
.LBB6_16:
	bf r3, .LBB6_17
	ldw r3, dp[mail_place]
	ldc r11, 48
	mul r5, r3, r11
	ldaw r4, dp[pool]
	add r5, r5, r4
	stw r5, dp[commit_slice]
	stw r1, dp[commit_period]
	stw r0, dp[commit_period+4]
	ldc r0, 0
	ldaw r1, dp[commit_came_last]
	mkmsk r5, 1
	st8 r5, r1[r0]
	or r0, r2, r5
	stw r0, dp[waiting]
	ldw r0, dp[now_plays.1]
	ldw r1, dp[told+8]
.LBB6_19:
	add r3, r3, 1
	zext r3, 2
	mul r2, r3, r11
	add r2, r2, r4
	eq r5, r2, r0
	bt r5, .LBB6_19
	eq r2, r2, r1
	bt r2, .LBB6_19
	stw r3, dp[mail_place]
	bu .LBB6_23
.LBB6_17:
	bl missed
.LBB6_23:
	ldw r5, sp[1]
	ldw r4, sp[2]
	retsp 3
	.cc_bottom play_message.function
.Lfunc_end6:
	.size	play_message, .Lfunc_end6-play_message

	.p2align	2
	.type	damaged,@function
	.cc_top damaged.function,damaged
damaged:
	ldw r0, dp[state_lock]
	in r0, res[r0]
	ldw r0, dp[told+40]
	add r0, r0, 1
	stw r0, dp[told+40]
	ldw r0, dp[state_lock]
	out res[r0], r0
	retsp 0
	.cc_bottom damaged.function
.Lfunc_end7:
	.size	damaged, .Lfunc_end7-damaged

	.section	.cp.rodata.cst4,"aMc",@progbits,4
	.p2align	2
.LCPI8_0:
	.long	4294966016
	.text
	.p2align	2
	.type	take_program,@function
	.cc_top take_program.function,take_program
take_program:
	entsp 6
	stw r4, sp[5]
	stw r5, sp[4]
	stw r6, sp[3]
	stw r7, sp[2]
	stw r8, sp[1]
	ldw r1, r0[1]
	ldw r2, r0[2]
	ldw r3, r0[4]
	ldw r11, r0[3]
	ldw r0, r0[0]
	mov r4, r1
	zext r4, 16
	shr r5, r1, 16
	add r4, r4, r5
	eq r5, r0, 3
	bt r5, .LBB8_5
	eq r5, r0, 2
	bf r5, .LBB8_7
	mkmsk r5, 16
	lsu r5, r5, r1
	bf r5, .LBB8_6
	ldc r5, 1024
	lsu r4, r5, r4
	bt r4, .LBB8_7
	mov r4, r2
	zext r4, 16
	bf r4, .LBB8_10
	bu .LBB8_7
.LBB8_5:
	mkmsk r5, 16
	lsu r6, r5, r1
	bt r6, .LBB8_8
.LBB8_6:
	or r4, r2, r1
	bf r4, .LBB8_10
.LBB8_7:
	bl damaged
	bu .LBB8_19
.LBB8_8:
	ldc r6, 4096
	lsu r4, r6, r4
	bt r4, .LBB8_7
	sub r4, r2, 1
	lsu r4, r4, r5
	bf r4, .LBB8_7
.LBB8_10:
	eq r5, r0, 2
	bt r5, .LBB8_14
	ldc r0, 4
	ldw r4, dp[began]
	bf r4, .LBB8_15
.LBB8_12:
	ldw r4, dp[play_clock]
	in r4, res[r4]
	ldw r6, dp[boundary]
	sub r4, r4, r6
	ashr r4, r4, 32
	bt r4, .LBB8_16
	ldc r6, 0
	stw r6, dp[began]
	bu .LBB8_17
.LBB8_14:
	ldc r0, 2
	ldw r4, dp[began]
	bt r4, .LBB8_12
.LBB8_15:
	ldc r6, 0
	bu .LBB8_17
.LBB8_16:
	ldw r6, dp[began]
.LBB8_17:
	ldw r4, dp[waiting]
	or r6, r4, r6
	and r6, r6, r0
	bf r6, .LBB8_20
.LBB8_18:
	bl missed
.LBB8_19:
	ldw r8, sp[1]
	ldw r7, sp[2]
	ldw r6, sp[3]
	ldw r5, sp[4]
	ldw r4, sp[5]
	retsp 6
.LBB8_20:
	ldw r6, dp[time_runs]
	bf r6, .LBB8_18
	ldw r6, dp[decided+4]
	ldw r7, dp[decided]
	eq r8, r6, r3
	bt r8, .LBB8_23
	lsu r8, r6, r3
	bu .LBB8_24
.LBB8_23:
	lsu r8, r7, r11
.LBB8_24:
	bf r8, .LBB8_18
	bf r5, .LBB8_28
	ldaw r5, dp[commit_came_last]
	ldc r6, 0
	st8 r6, r5[r6]
	ldaw r5, dp[waiting_sequence]
.LBB8_27:
	stw r11, r5[0]
	stw r3, r5[1]
	stw r1, r5[2]
	stw r2, r5[3]
	or r0, r4, r0
	stw r0, dp[waiting]
	bu .LBB8_19
.LBB8_28:
	ldc r5, 0
	mkmsk r8, 1
	ladd r8, r7, r7, r8, r5
	ldaw r5, dp[waiting_modulation]
	bf r1, .LBB8_27
	add r6, r6, r8
	xor r7, r11, r7
	xor r6, r3, r6
	or r6, r7, r6
	bt r6, .LBB8_27
	ldw r4, dp[boundary]
	ldw r6, dp[play_clock]
	in r6, res[r6]
	sub r6, r6, r4
	ldw r7, cp[.LCPI8_0]
	add r6, r6, r7
	ashr r6, r6, 32
	bf r6, .LBB8_18
	ldc r6, 1166
	add r4, r4, r6
	stw r4, dp[decide_at]
	ldw r4, dp[waiting]
	bu .LBB8_27
	.cc_bottom take_program.function
.Lfunc_end8:
	.size	take_program, .Lfunc_end8-take_program

	.section	.cp.rodata.cst4,"aMc",@progbits,4
	.p2align	2
.LCPI9_0:
	.long	5000000
	.text
	.globl	play_wake
	.p2align	2
	.type	play_wake,@function
	.cc_top play_wake.function,play_wake
play_wake:
	ldw r0, dp[heard]
	ldw r1, cp[.LCPI9_0]
	add r1, r0, r1
	ldw r0, dp[time_runs]
	eq r0, r0, 0
	eq r2, r0, 0
	ldw r0, dp[decide_at]
	sub r3, r1, r0
	ldc r11, 0
	lss r3, r11, r3
	and r2, r2, r3
	stw r2, dp[waits_to_decide]
	bt r2, .LBB9_2
	mov r0, r1
.LBB9_2:
	retsp 0
	.cc_bottom play_wake.function
.Lfunc_end9:
	.size	play_wake, .Lfunc_end9-play_wake

	.section	.cp.rodata.cst4,"aMc",@progbits,4
	.p2align	2
.LCPI10_0:
	.long	1426063360
.LCPI10_1:
	.long	4289967296
.LCPI10_2:
	.long	5000000
	.text
	.globl	play_time
	.p2align	2
	.type	play_time,@function
	.cc_top play_time.function,play_time
play_time:
	entsp 5
	stw r4, sp[4]
	stw r5, sp[3]
	stw r6, sp[2]
	stw r7, sp[1]
	ldw r0, dp[waits_to_decide]
	bf r0, .LBB10_6
	ldw r0, dp[decided+4]
	ldw r1, dp[decided]
	ldc r6, 0
	mkmsk r4, 1
	ladd r2, r1, r1, r4, r6
	add r0, r0, r2
	stw r1, dp[decided]
	stw r0, dp[decided+4]
	ldw r0, dp[boundary]
	ldc r2, 2500
	add r0, r0, r2
	stw r0, dp[boundary]
	stw r6, dp[began]
	ldw r0, dp[again]
	stw r0, dp[stepped]
	stw r6, dp[again]
	ldc r0, 4095
	and r0, r1, r0
	xor r0, r0, r4
	bt r0, .LBB10_3
	bl decide_sync
.LBB10_3:
	ldw r1, dp[waiting]
	ldc r5, 4
	bf r1, .LBB10_23
	mov r0, r1
	zext r0, 1
	bt r0, .LBB10_9
	ldc r0, 0
	bu .LBB10_10
.LBB10_6:
	ldw r0, dp[play_clock]
	in r1, res[r0]
	ldw r0, dp[heard]
	sub r1, r1, r0
	ldw r2, cp[.LCPI10_1]
	add r1, r1, r2
	ashr r1, r1, 32
	bt r1, .LBB10_68
	ldw r1, dp[time_runs]
	bf r1, .LBB10_41
	bl be_alone
	bu .LBB10_68
.LBB10_9:
	ldw r0, dp[commit_period]
	ldw r2, dp[commit_period+4]
	ldw r3, dp[decided]
	ldw r11, dp[decided+4]
	xor r2, r2, r11
	xor r0, r0, r3
	or r0, r0, r2
	eq r0, r0, 0
.LBB10_10:
	ldc r2, 2
	and r3, r1, r2
	bf r3, .LBB10_13
	ldw r3, dp[waiting_sequence]
	ldw r11, dp[waiting_sequence+4]
	ldw r6, dp[decided]
	ldw r7, dp[decided+4]
	xor r11, r11, r7
	xor r3, r3, r6
	or r3, r3, r11
	bt r3, .LBB10_13
	or r0, r0, r2
.LBB10_13:
	and r2, r1, r5
	bf r2, .LBB10_16
	ldw r2, dp[waiting_modulation]
	ldw r3, dp[waiting_modulation+4]
	ldw r11, dp[decided]
	ldw r6, dp[decided+4]
	xor r3, r3, r6
	xor r2, r2, r11
	or r2, r2, r3
	bt r2, .LBB10_16
	or r0, r0, r5
	stw r0, dp[began]
	andnot r1, r0
	stw r1, dp[waiting]
	bu .LBB10_21
.LBB10_16:
	stw r0, dp[began]
	bf r0, .LBB10_22
	andnot r1, r0
	stw r1, dp[waiting]
	eq r1, r0, 1
	bf r1, .LBB10_21
	mkmsk r6, 1
	stw r6, dp[kept]
	ldw r0, dp[now_plays.0]
	ldw r1, dp[now_plays.0+4]
	stw r1, dp[before_change.0+4]
	stw r0, dp[before_change.0]
	ldw r0, dp[now_plays.1]
	stw r0, dp[before_change.1]
	ldw r0, dp[now_plays.2]
	stw r0, dp[before_change.2]
	ldw r1, dp[sequence.0]
	stw r1, dp[sequence_before.0]
	ldc r1, 0
	stw r1, dp[sequence.0]
	add r0, r0, 1
	stw r0, dp[now_plays.2]
	ldw r0, dp[told+52]
	ldc r1, 28
	and r0, r0, r1
	ldw r1, dp[unsynced]
	or r0, r0, r1
	ldaw r11, cp[silence]
	bt r0, .LBB10_20
	ldw r11, dp[commit_slice]
.LBB10_20:
	stw r11, dp[now_plays.1]
	ldw r0, dp[decided+4]
	ldw r1, dp[decided]
	stw r1, dp[now_plays.0]
	stw r0, dp[now_plays.0+4]
	bu .LBB10_23
.LBB10_21:
	bl begin_several
	mov r6, r4
	bu .LBB10_23
.LBB10_22:
	ldc r6, 0
.LBB10_23:
	ldw r0, dp[sequence.0]
	ldw r4, dp[began]
	eq r0, r0, 2
	bf r0, .LBB10_27
	mov r0, r4
	zext r0, 2
	bt r0, .LBB10_27
	bl step_sequence
	bf r0, .LBB10_27
	mkmsk r6, 1
	stw r6, dp[stepped]
.LBB10_27:
	ldw r0, dp[modulation.0]
	bf r0, .LBB10_34
	and r1, r4, r5
	bt r1, .LBB10_35
	ldw r1, dp[modulation.4]
	sub r1, r1, 1
	stw r1, dp[modulation.4]
	bt r1, .LBB10_34
	ldw r1, dp[modulation.3]
	stw r1, dp[modulation.4]
	ldw r3, dp[modulation.2]
	ldc r1, 0
	ld8u r2, r3[r1]
	add r3, r3, 1
	ldw r11, dp[modulation.1]
	eq r11, r3, r11
	bt r11, .LBB10_32
	mov r0, r3
.LBB10_32:
	stw r0, dp[modulation.2]
	ld8u r0, r0[r1]
	eq r0, r0, r2
	bt r0, .LBB10_34
	mkmsk r0, 1
	stw r0, dp[stepped]
.LBB10_34:
	ldw r0, dp[stepped]
	or r0, r0, r4
	bf r0, .LBB10_54
.LBB10_35:
	ldw r0, dp[now_plays.1]
	ldaw r11, cp[silence]
	eq r0, r0, r11
	bt r0, .LBB10_38
	ldw r0, dp[play_clock]
	in r0, res[r0]
	ldw r1, dp[boundary]
	sub r0, r0, r1
	ashr r0, r0, 32
	bt r0, .LBB10_39
	ldc r0, 0
	bl overrun
	bt r6, .LBB10_55
.LBB10_57:
	ldw r0, dp[told+64]
	bt r0, .LBB10_60
	ldw r0, dp[told+32]
	ldw r1, dp[boundary]
	eq r0, r0, r1
	bt r0, .LBB10_60
	ldw r0, dp[state_lock]
	in r0, res[r0]
	ldw r0, dp[told+16]
	ldw r1, dp[told+20]
	stw r1, dp[told+4]
	stw r0, dp[told]
	ldw r0, dp[told+24]
	stw r0, dp[told+8]
	ldw r0, dp[told+28]
	stw r0, dp[told+12]
	mkmsk r0, 1
	stw r0, dp[told+64]
	ldw r0, dp[state_lock]
	out res[r0], r0
	bu .LBB10_60
.LBB10_38:
	ldaw r0, dp[silent_table]
	stw r0, dp[next_table]
	bt r6, .LBB10_55
	bu .LBB10_57
.LBB10_39:
	ldw r7, dp[table]
	ldaw r0, dp[tables+400]
	eq r0, r7, r0
	bt r0, .LBB10_42
	ldc r0, 200
	add r3, r7, r0
	bu .LBB10_43
.LBB10_41:
	ldw r1, cp[.LCPI10_2]
	add r0, r0, r1
	stw r0, dp[heard]
	bu .LBB10_68
.LBB10_42:
	ldaw r3, dp[tables]
.LBB10_43:
	stw r3, dp[table]
	ldw r0, dp[modulation.0]
	bf r0, .LBB10_45
	ldw r0, dp[modulation.2]
	ldc r1, 0
	ld8u r0, r0[r1]
	ldc r1, 26
	mul r0, r0, r1
	ldaw r1, dp[widths]
	add r1, r0, r1
	bu .LBB10_46
.LBB10_45:
	ldc r1, 0
.LBB10_46:
	ldw r0, dp[now_plays.1]
	ldaw r2, dp[no_edges]
	bl raster_begin
	mov r4, r0
	ldw r0, dp[temperature_port]
	peek r0, res[r0]
	zext r0, 8
	ldw r1, dp[told+60]
	eq r1, r0, r1
	bt r1, .LBB10_48
	shl r1, r0, 24
	ldw r2, dp[temperature_port]
	setd res[r2], r0
	stw r0, dp[told+60]
	ldw r0, cp[.LCPI10_0]
	lss r1, r0, r1
	ldc r0, 8
	bl set_fault
.LBB10_48:
	ldw r0, dp[supply_port]
	peek r0, res[r0]
	ldw r1, dp[told+52]
	shr r1, r1, 4
	xor r1, r1, r0
	zext r1, 1
	bt r1, .LBB10_50
	ldw r1, dp[supply_port]
	zext r0, 1
	setd res[r1], r0
	eq r1, r0, 0
	ldc r0, 16
	bl set_fault
.LBB10_50:
	ldw r0, dp[now_plays.1]
	ldaw r11, cp[silence]
	eq r0, r0, r11
	bt r0, .LBB10_56
	ldw r0, dp[play_clock]
	in r0, res[r0]
	ldw r1, dp[boundary]
	sub r0, r0, r1
	ldc r1, 70
	add r0, r0, r1
	ashr r0, r0, 32
	bt r0, .LBB10_53
	mkmsk r0, 1
	bl overrun
	bf r0, .LBB10_56
.LBB10_53:
	ldw r0, dp[table]
	stw r0, dp[next_table]
	ldw r0, dp[table]
	add r1, r0, 8
	ldaw r0, dp[no_edges+8]
	mov r2, r4
	bl raster_end
.LBB10_54:
	bf r6, .LBB10_57
.LBB10_55:
	ldw r0, dp[boundary]
	bl tell
.LBB10_60:
	ldw r0, dp[modulation.0]
	bf r0, .LBB10_62
.LBB10_66:
	ldc r0, 1166
	bu .LBB10_67
.LBB10_62:
	ldaw r0, dp[waiting]
	ldc r1, 0
	ld8u r0, r0[r1]
	and r2, r0, r5
	ldc r0, 1426
	bf r2, .LBB10_67
	ldw r2, dp[waiting_modulation+4]
	ldw r3, dp[waiting_modulation]
	ldw r11, dp[decided+4]
	ldw r4, dp[decided]
	mkmsk r5, 1
	ladd r4, r1, r4, r5, r1
	add r11, r11, r4
	xor r1, r3, r1
	xor r2, r2, r11
	or r1, r1, r2
	bt r1, .LBB10_67
	ldw r0, dp[waiting_modulation+8]
	bt r0, .LBB10_66
	ldc r0, 1426
.LBB10_67:
	ldw r1, dp[boundary]
	add r0, r1, r0
	stw r0, dp[decide_at]
.LBB10_68:
	ldw r7, sp[1]
	ldw r6, sp[2]
	ldw r5, sp[3]
	ldw r4, sp[4]
	retsp 5
.LBB10_56:
	ldw r0, dp[table]
	add r1, r0, 8
	ldaw r0, dp[no_edges+8]
	mov r2, r4
	bl raster_end
	stw r7, dp[table]
	bt r6, .LBB10_55
	bu .LBB10_57
	.cc_bottom play_time.function
.Lfunc_end10:
	.size	play_time, .Lfunc_end10-play_time

	.p2align	2
	.type	be_alone,@function
	.cc_top be_alone.function,be_alone
be_alone:
	entsp 1
	ldw r0, dp[state_lock]
	in r0, res[r0]
	ldw r0, dp[told+44]
	add r0, r0, 1
	stw r0, dp[told+44]
	ldw r0, dp[state_lock]
	out res[r0], r0
	ldw r0, dp[play_clock]
	in r0, res[r0]
	stw r0, dp[heard]
	bl fall_silent
	retsp 1
	.cc_bottom be_alone.function
.Lfunc_end11:
	.size	be_alone, .Lfunc_end11-be_alone

	.section	.cp.rodata.cst4,"aMc",@progbits,4
	.p2align	2
.LCPI12_0:
	.long	5000000
.LCPI12_1:
	.long	1426063360
.LCPI12_2:
	.long	3221225472
.LCPI12_3:
	.long	204825
.LCPI12_4:
	.long	1374389535
.LCPI12_5:
	.long	4294963200
.LCPI12_6:
	.long	4294960921
.LCPI12_7:
	.long	4294967168
.LCPI12_8:
	.long	4294967292
	.text
	.globl	play
	.p2align	2
	.type	play,@function
	.cc_top play.function,play
play:
	entsp 8
	stw r4, sp[7]
	stw r5, sp[6]
	stw r6, sp[5]
	stw r7, sp[4]
	stw r8, sp[3]
	stw r9, sp[2]
	stw r10, sp[1]
	bl play_events
	ldw r8, cp[.LCPI12_0]
	ldc r9, 0
	ldc r10, 128
	mkmsk r4, 2
	ldaw r7, dp[sync_came]
	mkmsk r5, 1
	ldc r6, 4
	bu .LBB12_1
.LBB12_18:
	ldw r0, dp[temperature_port]
	in r0, res[r0]
	shl r1, r0, 24
	ldw r2, dp[temperature_port]
	zext r0, 8
	setd res[r2], r0
	stw r0, dp[told+60]
	ldw r0, cp[.LCPI12_1]
	lss r1, r0, r1
	ldc r0, 8
	bl set_fault
.LBB12_1:
	ldw r0, dp[heard]
	add r1, r0, r8
	ldw r0, dp[time_runs]
	eq r0, r0, 0
	eq r2, r0, 0
	ldw r0, dp[decide_at]
	sub r3, r1, r0
	lss r3, r9, r3
	and r2, r2, r3
	stw r2, dp[waits_to_decide]
	bt r2, .LBB12_3
	mov r0, r1
.LBB12_3:
	bl play_wait
	bf r0, .LBB12_4
.LBB12_6:
	sub r0, r0, 1
	lsu r1, r4, r0
	bt r1, .LBB12_19
	bru r0
	.jmptable .LBB12_8,.LBB12_9,.LBB12_11,.LBB12_18
.LBB12_8:
	ldw r0, dp[play_inbox]
	chkct res[r0], 1
	ldw r0, dp[take_event.message]
	bl play_message
	ldw r0, dp[take_event.message]
	ldc r1, 60
	add r0, r0, r1
	ldw r0, r0[0]
	stw r0, dp[take_event.message]
	ldw r0, dp[play_ready]
	outct res[r0], 1
	bu .LBB12_1
.LBB12_4:
	bl play_time
	ldw r0, dp[play_clock]
	in r0, res[r0]
	ldw r1, dp[decide_at]
	sub r0, r0, r1
	ashr r0, r0, 32
	bt r0, .LBB12_1
	ldw r0, dp[play_clock]
	in r0, res[r0]
	add r0, r0, r10
	bl play_wait
	bt r0, .LBB12_6
	bu .LBB12_1
.LBB12_9:
	ldw r0, dp[started_to]
	chkct res[r0], 1
	ldw r0, dp[first_time]
	stw r0, dp[heard]
	ldw r1, dp[first_stamp]
	stw r1, dp[sync_stamp]
	stw r0, dp[boundary]
	st8 r5, r7[r9]
	stw r5, dp[time_runs]
	stw r0, dp[told+32]
	ldc r1, 1426
	add r0, r0, r1
	stw r0, dp[decide_at]
	ldw r0, dp[sync_port]
	setd res[r0], r5
	ldw r0, dp[unsynced]
	bt r0, .LBB12_10
	bu .LBB12_1
.LBB12_11:
	ldw r0, dp[sync_port]
	getts r0, res[r0]
	ldw r1, dp[sync_port]
	in r1, res[r1]
	ldw r1, dp[sync_port]
	edu res[r1]
	st8 r5, r7[r9]
	ldw r1, dp[sync_stamp]
	sub r1, r0, r1
	shl r1, r1, 16
	ldw r2, cp[.LCPI12_2]
	add r1, r1, r2
	ashr r1, r1, 16
	ldw r2, dp[sync_offset]
	add r1, r1, r2
	stw r1, dp[sync_offset]
	stw r0, dp[sync_stamp]
	bf r1, .LBB12_12
	ldw r0, cp[.LCPI12_3]
	add r0, r1, r0
	mov r2, r9
	mov r3, r9
	ldw r11, cp[.LCPI12_4]
	maccs r2, r3, r0, r11
	mkmsk r0, 5
	shr r0, r2, r0
	ashr r2, r2, 4
	add r0, r2, r0
	ldw r2, cp[.LCPI12_5]
	add r0, r0, r2
	ldw r2, dp[state_lock]
	in r2, res[r2]
	ldc r2, 6324
	lss r2, r2, r1
	bt r2, .LBB12_14
	ldw r2, cp[.LCPI12_6]
	lss r3, r1, r2
	mov r1, r0
	ldw r2, cp[.LCPI12_7]
	bf r3, .LBB12_16
	bu .LBB12_17
.LBB12_19:
	ldw r0, dp[supply_port]
	in r0, res[r0]
	ldw r1, dp[supply_port]
	zext r0, 1
	setd res[r1], r0
	eq r1, r0, 0
	ldc r0, 16
	bl set_fault
	bu .LBB12_1
.LBB12_12:
	ldw r0, dp[state_lock]
	in r0, res[r0]
	mov r1, r9
	mov r0, r9
	bu .LBB12_16
.LBB12_14:
	mkmsk r1, 7
.LBB12_16:
	mov r2, r1
.LBB12_17:
	stw r2, dp[told+56]
	ldw r1, dp[state_lock]
	out res[r1], r1
	sub r0, r0, 2
	ldw r1, cp[.LCPI12_8]
	lsu r0, r1, r0
	bt r0, .LBB12_1
.LBB12_10:
	mov r0, r6
	mov r1, r5
	bl set_fault
	bu .LBB12_1
	.cc_bottom play.function
.Lfunc_end12:
	.size	play, .Lfunc_end12-play

	.p2align	2
	.type	fall_silent,@function
	.cc_top fall_silent.function,fall_silent
fall_silent:
	entsp 3
	stw r4, sp[2]
	stw r5, sp[1]
	ldw r1, dp[waiting]
	zext r1, 1
	ldc r2, 0
	stw r2, dp[waiting]
	ldw r0, dp[time_runs]
	bf r0, .LBB13_1
	ldw r4, dp[decided+4]
	ldw r3, dp[decided]
	ldw r0, dp[boundary]
	ldaw r11, dp[silent_table]
	stw r11, dp[next_table]
	ldw r11, dp[play_clock]
	in r11, res[r11]
	ldw r5, dp[boundary]
	sub r11, r11, r5
	ldc r5, 70
	add r11, r11, r5
	ashr r11, r11, 32
	bt r11, .LBB13_4
	mkmsk r11, 1
	ladd r11, r3, r3, r11, r2
	add r4, r4, r11
	ldc r11, 2500
	add r0, r0, r11
	bu .LBB13_6
.LBB13_1:
	ldw r0, dp[state_lock]
	in r0, res[r0]
	ldw r0, dp[told+36]
	add r0, r0, r1
	stw r0, dp[told+36]
	ldw r0, dp[told+44]
	sub r0, r0, r1
	stw r0, dp[told+44]
	ldw r0, dp[state_lock]
	out res[r0], r0
	bu .LBB13_9
.LBB13_4:
	ldaw r11, dp[began]
	ld8u r11, r11[r2]
	zext r11, 1
	bf r11, .LBB13_6
	add r1, r1, 1
	ldw r11, dp[now_plays.2]
	sub r11, r11, 1
	stw r11, dp[now_plays.2]
.LBB13_6:
	ldw r11, dp[decided+4]
	ldw r5, dp[decided]
	xor r5, r3, r5
	xor r11, r4, r11
	or r11, r5, r11
	bt r11, .LBB13_8
	stw r2, dp[began]
.LBB13_8:
	ldw r11, dp[state_lock]
	in r11, res[r11]
	ldw r11, dp[told+36]
	add r11, r11, r1
	stw r11, dp[told+36]
	ldw r11, dp[told+44]
	sub r1, r11, r1
	stw r1, dp[told+44]
	ldw r1, dp[state_lock]
	out res[r1], r1
	stw r2, dp[sequence.0]
	stw r2, dp[modulation.0]
	stw r2, dp[again]
	ldaw r11, cp[silence]
	stw r11, dp[now_plays.1]
	stw r4, dp[now_plays.0+4]
	stw r3, dp[now_plays.0]
	bl tell
.LBB13_9:
	ldw r5, sp[1]
	ldw r4, sp[2]
	retsp 3
	.cc_bottom fall_silent.function
.Lfunc_end13:
	.size	fall_silent, .Lfunc_end13-fall_silent

	.p2align	2
	.type	tell,@function
	.cc_top tell.function,tell
tell:
	ldw r1, dp[state_lock]
	in r1, res[r1]
	ldw r1, dp[told+32]
	eq r1, r1, r0
	bt r1, .LBB14_2
	ldw r1, dp[told+16]
	ldw r2, dp[told+20]
	stw r2, dp[told+4]
	stw r1, dp[told]
	ldw r1, dp[told+24]
	stw r1, dp[told+8]
	ldw r1, dp[told+28]
	stw r1, dp[told+12]
	stw r0, dp[told+32]
.LBB14_2:
	ldw r0, dp[now_plays.0]
	ldw r1, dp[now_plays.0+4]
	stw r1, dp[told+20]
	stw r0, dp[told+16]
	ldw r0, dp[now_plays.1]
	stw r0, dp[told+24]
	ldw r0, dp[now_plays.2]
	stw r0, dp[told+28]
	ldc r0, 0
	stw r0, dp[told+64]
	ldw r0, dp[state_lock]
	out res[r0], r0
	retsp 0
	.cc_bottom tell.function
.Lfunc_end14:
	.size	tell, .Lfunc_end14-tell

	.p2align	2
	.type	missed,@function
	.cc_top missed.function,missed
missed:
	ldw r0, dp[state_lock]
	in r0, res[r0]
	ldw r0, dp[told+36]
	add r0, r0, 1
	stw r0, dp[told+36]
	ldw r0, dp[state_lock]
	out res[r0], r0
	retsp 0
	.cc_bottom missed.function
.Lfunc_end15:
	.size	missed, .Lfunc_end15-missed

	.p2align	2
	.type	decide_sync,@function
	.cc_top decide_sync.function,decide_sync
decide_sync:
	entsp 3
	stw r4, sp[2]
	stw r5, sp[1]
	ldc r4, 0
	ldaw r5, dp[sync_came]
	ld8u r0, r5[r4]
	bt r0, .LBB16_2
	ldc r0, 4
	mkmsk r1, 1
	bl set_fault
.LBB16_2:
	st8 r4, r5[r4]
	ldw r0, dp[sync_port]
	eeu res[r0]
	ldw r5, sp[1]
	ldw r4, sp[2]
	retsp 3
	.cc_bottom decide_sync.function
.Lfunc_end16:
	.size	decide_sync, .Lfunc_end16-decide_sync

	.section	.cp.rodata.cst4,"aMc",@progbits,4
	.p2align	2
.LCPI17_0:
	.long	4294967293
	.text
	.p2align	2
	.type	begin_several,@function
	.cc_top begin_several.function,begin_several
begin_several:
	extsp 4
	stw r4, sp[3]
	stw r5, sp[2]
	stw r6, sp[1]
	stw r7, sp[0]
	ldw r1, dp[told+52]
	ldc r2, 28
	and r1, r1, r2
	ldw r2, dp[unsynced]
	or r3, r1, r2
	bf r3, .LBB17_2
	zext r0, 1
	bu .LBB17_9
.LBB17_2:
	mov r1, r0
	zext r1, 2
	eq r1, r1, 3
	bf r1, .LBB17_9
	ldc r1, 0
	ldaw r2, dp[commit_came_last]
	ld8u r2, r2[r1]
	ldw r11, dp[waiting_sequence+8]
	ldw r1, cp[.LCPI17_0]
	bt r11, .LBB17_4
	mov r11, r1
	bf r2, .LBB17_7
	bu .LBB17_8
.LBB17_4:
	mkmsk r11, 32
	bt r2, .LBB17_8
.LBB17_7:
	mov r1, r11
.LBB17_8:
	and r0, r1, r0
.LBB17_9:
	stw r0, dp[kept]
	ldw r1, dp[now_plays.0]
	ldw r2, dp[now_plays.0+4]
	stw r2, dp[before_change.0+4]
	stw r1, dp[before_change.0]
	ldw r1, dp[now_plays.1]
	stw r1, dp[before_change.1]
	ldw r4, dp[now_plays.2]
	stw r4, dp[before_change.2]
	ldw r5, dp[sequence.0]
	stw r5, dp[sequence_before.0]
	ldc r11, 2
	and r6, r0, r11
	bf r6, .LBB17_11
	ldw r1, dp[sequence.1]
	stw r1, dp[sequence_before.1]
	ldw r1, dp[sequence.2]
	stw r1, dp[sequence_before.2]
	ldw r1, dp[sequence.3]
	stw r1, dp[sequence_before.3]
	ldw r1, dp[sequence.4]
	stw r1, dp[sequence_before.4]
	ldw r1, dp[sequence.5]
	stw r1, dp[sequence_before.5]
.LBB17_11:
	ldc r1, 4
	and r1, r0, r1
	bf r1, .LBB17_13
	ldw r2, dp[modulation.0]
	stw r2, dp[modulation_before.0]
	ldw r2, dp[modulation.1]
	stw r2, dp[modulation_before.1]
	ldw r2, dp[modulation.2]
	stw r2, dp[modulation_before.2]
	ldw r2, dp[modulation.3]
	stw r2, dp[modulation_before.3]
	ldw r2, dp[modulation.4]
	stw r2, dp[modulation_before.4]
.LBB17_13:
	zext r0, 1
	mkmsk r2, 16
	bt r6, .LBB17_14
	bf r0, .LBB17_28
	eq r0, r3, 0
	eq r0, r0, 0
	ldc r3, 0
	stw r3, dp[sequence.0]
	add r3, r4, 1
	stw r3, dp[now_plays.2]
	ldaw r11, cp[silence]
	bt r0, .LBB17_27
	ldw r11, dp[commit_slice]
	bu .LBB17_27
.LBB17_14:
	add r0, r4, r0
	stw r0, dp[now_plays.2]
	ldw r3, dp[waiting_sequence+8]
	lsu r0, r2, r3
	bt r0, .LBB17_17
	bf r5, .LBB17_28
.LBB17_16:
	ldc r0, 0
	stw r0, dp[sequence.0]
	ldaw r11, cp[silence]
	bu .LBB17_27
.LBB17_17:
	shr r0, r3, 16
	zext r3, 16
	ldaw r4, dp[entries]
	ldaw r3, r4[r3]
	stw r3, dp[sequence.1]
	ldaw r4, r3[r0]
	stw r4, dp[sequence.2]
	ldw r5, dp[waiting_sequence+12]
	shr r5, r5, 16
	stw r5, dp[sequence.5]
	stw r11, dp[sequence.0]
	mov r11, r3
	bu .LBB17_18
.LBB17_22:
	eq r11, r5, 0
	eq r11, r11, 0
	sub r5, r5, r11
	stw r5, dp[sequence.5]
	mov r11, r3
.LBB17_23:
	sub r0, r0, 1
	bf r0, .LBB17_16
.LBB17_18:
	ldw r6, r11[0]
	lsu r7, r2, r6
	bt r7, .LBB17_33
	add r11, r11, 4
	eq r6, r11, r4
	bf r6, .LBB17_23
	eq r11, r0, 1
	bt r11, .LBB17_16
	eq r11, r5, 1
	bf r11, .LBB17_22
	bu .LBB17_16
.LBB17_33:
	stw r11, dp[sequence.3]
	shr r0, r6, 16
	stw r0, dp[sequence.4]
	ldc r0, 0
	ld8u r0, r11[r0]
	ldc r3, 48
	mul r0, r0, r3
	ldaw r3, dp[slots]
	add r11, r0, r3
.LBB17_27:
	stw r11, dp[now_plays.1]
	ldw r0, dp[decided]
	ldw r3, dp[decided+4]
	stw r3, dp[now_plays.0+4]
	stw r0, dp[now_plays.0]
.LBB17_28:
	bf r1, .LBB17_32
	ldw r0, dp[waiting_modulation+8]
	lsu r1, r2, r0
	bt r1, .LBB17_31
	ldc r0, 0
	stw r0, dp[modulation.0]
	bu .LBB17_32
.LBB17_31:
	shr r1, r0, 16
	zext r0, 16
	ldaw r2, dp[samples]
	add r0, r0, r2
	stw r0, dp[modulation.0]
	add r1, r0, r1
	stw r1, dp[modulation.1]
	stw r0, dp[modulation.2]
	ldc r0, 0
	ldaw r1, dp[waiting_modulation+12]
	ld16s r0, r1[r0]
	zext r0, 16
	stw r0, dp[modulation.3]
	stw r0, dp[modulation.4]
.LBB17_32:
	ldw r7, sp[0]
	ldw r6, sp[1]
	ldw r5, sp[2]
	ldw r4, sp[3]
	ldaw sp, sp[4]
	retsp 0
	.cc_bottom begin_several.function
.Lfunc_end17:
	.size	begin_several, .Lfunc_end17-begin_several

	.p2align	2
	.type	step_sequence,@function
	.cc_top step_sequence.function,step_sequence
step_sequence:
	extsp 3
	stw r4, sp[2]
	stw r5, sp[1]
	stw r6, sp[0]
	ldw r0, dp[sequence.4]
	sub r0, r0, 1
	stw r0, dp[sequence.4]
	bt r0, .LBB18_13
	ldw r1, dp[sequence.3]
	add r3, r1, 4
	ldw r1, dp[sequence.2]
	ldw r2, dp[sequence.1]
	eq r11, r3, r1
	bt r11, .LBB18_2
.LBB18_4:
	sub r11, r1, r2
	ashr r11, r11, 2
	mkmsk r4, 16
	bu .LBB18_5
.LBB18_9:
	eq r5, r3, 0
	eq r5, r5, 0
	sub r3, r3, r5
	stw r3, dp[sequence.5]
	mov r3, r2
.LBB18_10:
	sub r11, r11, 1
	bf r11, .LBB18_11
.LBB18_5:
	ldw r5, r3[0]
	lsu r6, r4, r5
	bt r6, .LBB18_14
	add r3, r3, 4
	eq r5, r3, r1
	bf r5, .LBB18_10
	eq r3, r11, 1
	bt r3, .LBB18_11
	ldw r3, dp[sequence.5]
	eq r5, r3, 1
	bf r5, .LBB18_9
	bu .LBB18_11
.LBB18_14:
	stw r3, dp[sequence.3]
	shr r1, r5, 16
	stw r1, dp[sequence.4]
	ldc r1, 0
	ld8u r1, r3[r1]
	ldc r2, 48
	mul r1, r1, r2
	ldaw r2, dp[slots]
	add r11, r1, r2
	bu .LBB18_12
.LBB18_2:
	ldw r11, dp[sequence.5]
	mov r3, r2
	bf r11, .LBB18_4
	sub r11, r11, 1
	stw r11, dp[sequence.5]
	mov r3, r2
	bt r11, .LBB18_4
.LBB18_11:
	mkmsk r1, 1
	stw r1, dp[sequence.0]
	ldaw r11, cp[silence]
.LBB18_12:
	stw r11, dp[now_plays.1]
	ldw r1, dp[decided]
	ldw r2, dp[decided+4]
	stw r2, dp[now_plays.0+4]
	stw r1, dp[now_plays.0]
.LBB18_13:
	eq r0, r0, 0
	ldw r6, sp[0]
	ldw r5, sp[1]
	ldw r4, sp[2]
	ldaw sp, sp[3]
	retsp 0
	.cc_bottom step_sequence.function
.Lfunc_end18:
	.size	step_sequence, .Lfunc_end18-step_sequence

	.p2align	2
	.type	overrun,@function
	.cc_top overrun.function,overrun
overrun:
	entsp 3
	stw r4, sp[2]
	stw r5, sp[1]
	ldw r1, dp[began]
	mov r2, r1
	zext r2, 1
	shr r3, r1, 1
	zext r3, 1
	shr r1, r1, 2
	add r1, r1, r2
	add r1, r1, r3
	ldw r2, dp[state_lock]
	in r2, res[r2]
	ldw r2, dp[told+48]
	add r2, r2, 1
	stw r2, dp[told+48]
	ldw r2, dp[told+36]
	add r1, r1, r2
	stw r1, dp[told+36]
	ldw r1, dp[state_lock]
	out res[r1], r1
	ldw r4, dp[began]
	bf r4, .LBB19_1
	ldw r0, dp[before_change.0]
	ldw r1, dp[before_change.0+4]
	stw r1, dp[now_plays.0+4]
	stw r0, dp[now_plays.0]
	ldw r0, dp[before_change.1]
	stw r0, dp[now_plays.1]
	ldw r0, dp[before_change.2]
	stw r0, dp[now_plays.2]
	ldw r0, dp[sequence_before.0]
	stw r0, dp[sequence.0]
	ldw r1, dp[kept]
	ldc r2, 2
	and r2, r1, r2
	bf r2, .LBB19_4
	ldw r2, dp[sequence_before.1]
	stw r2, dp[sequence.1]
	ldw r2, dp[sequence_before.2]
	stw r2, dp[sequence.2]
	ldw r2, dp[sequence_before.3]
	stw r2, dp[sequence.3]
	ldw r2, dp[sequence_before.4]
	stw r2, dp[sequence.4]
	ldw r2, dp[sequence_before.5]
	stw r2, dp[sequence.5]
.LBB19_4:
	ldc r5, 4
	and r1, r1, r5
	bf r1, .LBB19_6
	ldw r1, dp[modulation_before.0]
	stw r1, dp[modulation.0]
	ldw r1, dp[modulation_before.1]
	stw r1, dp[modulation.1]
	ldw r1, dp[modulation_before.2]
	stw r1, dp[modulation.2]
	ldw r1, dp[modulation_before.3]
	stw r1, dp[modulation.3]
	ldw r1, dp[modulation_before.4]
	stw r1, dp[modulation.4]
.LBB19_6:
	mov r1, r4
	zext r1, 2
	bf r1, .LBB19_10
	eq r0, r0, 2
	bf r0, .LBB19_10
	bl step_sequence
	bf r0, .LBB19_10
	mkmsk r0, 1
	stw r0, dp[stepped]
.LBB19_10:
	and r1, r4, r5
	ldc r0, 0
	bf r1, .LBB19_17
	ldw r1, dp[modulation.0]
	bf r1, .LBB19_17
	ldw r2, dp[modulation.4]
	sub r2, r2, 1
	stw r2, dp[modulation.4]
	bt r2, .LBB19_17
	ldw r2, dp[modulation.3]
	stw r2, dp[modulation.4]
	ldw r11, dp[modulation.2]
	ldc r2, 0
	ld8u r3, r11[r2]
	add r11, r11, 1
	ldw r4, dp[modulation.1]
	eq r4, r11, r4
	bt r4, .LBB19_15
	mov r1, r11
.LBB19_15:
	stw r1, dp[modulation.2]
	ld8u r1, r1[r2]
	eq r1, r1, r3
	bt r1, .LBB19_17
	mkmsk r1, 1
	stw r1, dp[stepped]
.LBB19_17:
	stw r0, dp[began]
	ldw r1, dp[stepped]
	bu .LBB19_18
.LBB19_1:
	mkmsk r1, 1
	xor r1, r0, r1
.LBB19_18:
	stw r1, dp[again]
	ldw r5, sp[1]
	ldw r4, sp[2]
	retsp 3
	.cc_bottom overrun.function
.Lfunc_end19:
	.size	overrun, .Lfunc_end19-overrun

	.section	.cp.rodata,"ac",@progbits
	.cc_top silence.data,silence
	.p2align	2
	.type	silence,@object
	.size	silence, 48
silence:
	.space	48
	.cc_bottom silence.data
	.section	.dp.bss,"awd",@nobits
	.cc_top now_plays.0.data,now_plays.0
	.p2align	2
	.type	now_plays.0,@object
	.size	now_plays.0, 8
now_plays.0:
	.long	0
	.long	0
	.cc_bottom now_plays.0.data
	.cc_top now_plays.1.data,now_plays.1
	.p2align	2
	.type	now_plays.1,@object
	.size	now_plays.1, 4
now_plays.1:
	.long	0
	.cc_bottom now_plays.1.data
	.cc_top now_plays.2.data,now_plays.2
	.p2align	2
	.type	now_plays.2,@object
	.size	now_plays.2, 4
now_plays.2:
	.long	0
	.cc_bottom now_plays.2.data
	.cc_top told.data,told
	.globl	told
	.p2align	2
	.type	told,@object
	.size	told, 68
told:
	.space	68
	.cc_bottom told.data
	.cc_top next_table.data,next_table
	.globl	next_table
	.p2align	2
	.type	next_table,@object
	.size	next_table, 4
next_table:
	.long	0
	.cc_bottom next_table.data
	.cc_top table.data,table
	.p2align	2
	.type	table,@object
	.size	table, 4
table:
	.long	0
	.cc_bottom table.data
	.cc_top sync_stamp.data,sync_stamp
	.p2align	2
	.type	sync_stamp,@object
	.size	sync_stamp, 4
sync_stamp:
	.long	0
	.cc_bottom sync_stamp.data
	.cc_top boundary.data,boundary
	.p2align	2
	.type	boundary,@object
	.size	boundary, 4
boundary:
	.long	0
	.cc_bottom boundary.data
	.cc_top sync_came.data,sync_came
	.p2align	2
	.type	sync_came,@object
	.size	sync_came, 1
sync_came:
	.byte	0
	.space	3
	.cc_bottom sync_came.data
	.cc_top time_runs.data,time_runs
	.globl	time_runs
	.p2align	2
	.type	time_runs,@object
	.size	time_runs, 4
time_runs:
	.long	0
	.cc_bottom time_runs.data
	.cc_top decide_at.data,decide_at
	.p2align	2
	.type	decide_at,@object
	.size	decide_at, 4
decide_at:
	.long	0
	.cc_bottom decide_at.data
	.cc_top unsynced.data,unsynced
	.globl	unsynced
	.p2align	2
	.type	unsynced,@object
	.size	unsynced, 4
unsynced:
	.long	0
	.cc_bottom unsynced.data
	.cc_top sync_offset.data,sync_offset
	.p2align	2
	.type	sync_offset,@object
	.size	sync_offset, 4
sync_offset:
	.long	0
	.cc_bottom sync_offset.data
	.cc_top waits_to_decide.data,waits_to_decide
	.p2align	2
	.type	waits_to_decide,@object
	.size	waits_to_decide, 4
waits_to_decide:
	.long	0
	.cc_bottom waits_to_decide.data
	.cc_top waiting.data,waiting
	.p2align	2
	.type	waiting,@object
	.size	waiting, 4
waiting:
	.long	0
	.cc_bottom waiting.data
	.cc_top decided.data,decided
	.p2align	2
	.type	decided,@object
	.size	decided, 8
decided:
	.long	0
	.long	0
	.cc_bottom decided.data
	.cc_top began.data,began
	.p2align	2
	.type	began,@object
	.size	began, 4
began:
	.long	0
	.cc_bottom began.data
	.cc_top sequence.0.data,sequence.0
	.p2align	2
	.type	sequence.0,@object
	.size	sequence.0, 4
sequence.0:
	.long	0
	.cc_bottom sequence.0.data
	.cc_top sequence.1.data,sequence.1
	.p2align	2
	.type	sequence.1,@object
	.size	sequence.1, 4
sequence.1:
	.long	0
	.cc_bottom sequence.1.data
	.cc_top sequence.2.data,sequence.2
	.p2align	2
	.type	sequence.2,@object
	.size	sequence.2, 4
sequence.2:
	.long	0
	.cc_bottom sequence.2.data
	.cc_top sequence.3.data,sequence.3
	.p2align	2
	.type	sequence.3,@object
	.size	sequence.3, 4
sequence.3:
	.long	0
	.cc_bottom sequence.3.data
	.cc_top sequence.4.data,sequence.4
	.p2align	2
	.type	sequence.4,@object
	.size	sequence.4, 4
sequence.4:
	.long	0
	.cc_bottom sequence.4.data
	.cc_top sequence.5.data,sequence.5
	.p2align	2
	.type	sequence.5,@object
	.size	sequence.5, 4
sequence.5:
	.long	0
	.cc_bottom sequence.5.data
	.cc_top modulation.0.data,modulation.0
	.p2align	2
	.type	modulation.0,@object
	.size	modulation.0, 4
modulation.0:
	.long	0
	.cc_bottom modulation.0.data
	.cc_top modulation.1.data,modulation.1
	.p2align	2
	.type	modulation.1,@object
	.size	modulation.1, 4
modulation.1:
	.long	0
	.cc_bottom modulation.1.data
	.cc_top modulation.2.data,modulation.2
	.p2align	2
	.type	modulation.2,@object
	.size	modulation.2, 4
modulation.2:
	.long	0
	.cc_bottom modulation.2.data
	.cc_top modulation.3.data,modulation.3
	.p2align	2
	.type	modulation.3,@object
	.size	modulation.3, 4
modulation.3:
	.long	0
	.cc_bottom modulation.3.data
	.cc_top modulation.4.data,modulation.4
	.p2align	2
	.type	modulation.4,@object
	.size	modulation.4, 4
modulation.4:
	.long	0
	.cc_bottom modulation.4.data
	.cc_top again.data,again
	.p2align	2
	.type	again,@object
	.size	again, 4
again:
	.long	0
	.cc_bottom again.data
	.cc_top pool.data,pool
	.p2align	2
	.type	pool,@object
	.size	pool, 192
pool:
	.space	192
	.cc_bottom pool.data
	.cc_top mail_place.data,mail_place
	.p2align	2
	.type	mail_place,@object
	.size	mail_place, 4
mail_place:
	.long	0
	.cc_bottom mail_place.data
	.cc_top mail_crc.data,mail_crc
	.p2align	2
	.type	mail_crc,@object
	.size	mail_crc, 4
mail_crc:
	.long	0
	.cc_bottom mail_crc.data
	.cc_top has_mail.data,has_mail
	.p2align	2
	.type	has_mail,@object
	.size	has_mail, 1
has_mail:
	.byte	0
	.space	3
	.cc_bottom has_mail.data
	.cc_top commit_slice.data,commit_slice
	.p2align	2
	.type	commit_slice,@object
	.size	commit_slice, 4
commit_slice:
	.long	0
	.cc_bottom commit_slice.data
	.cc_top commit_period.data,commit_period
	.p2align	2
	.type	commit_period,@object
	.size	commit_period, 8
commit_period:
	.long	0
	.long	0
	.cc_bottom commit_period.data
	.cc_top commit_came_last.data,commit_came_last
	.p2align	2
	.type	commit_came_last,@object
	.size	commit_came_last, 1
commit_came_last:
	.byte	0
	.space	3
	.cc_bottom commit_came_last.data
	.cc_top waiting_sequence.data,waiting_sequence
	.p2align	2
	.type	waiting_sequence,@object
	.size	waiting_sequence, 16
waiting_sequence:
	.space	16
	.cc_bottom waiting_sequence.data
	.cc_top waiting_modulation.data,waiting_modulation
	.p2align	2
	.type	waiting_modulation,@object
	.size	waiting_modulation, 16
waiting_modulation:
	.space	16
	.cc_bottom waiting_modulation.data
	.cc_top stepped.data,stepped
	.p2align	2
	.type	stepped,@object
	.size	stepped, 4
stepped:
	.long	0
	.cc_bottom stepped.data
	.cc_top kept.data,kept
	.p2align	2
	.type	kept,@object
	.size	kept, 4
kept:
	.long	0
	.cc_bottom kept.data
	.cc_top before_change.0.data,before_change.0
	.p2align	2
	.type	before_change.0,@object
	.size	before_change.0, 8
before_change.0:
	.long	0
	.long	0
	.cc_bottom before_change.0.data
	.cc_top before_change.1.data,before_change.1
	.p2align	2
	.type	before_change.1,@object
	.size	before_change.1, 4
before_change.1:
	.long	0
	.cc_bottom before_change.1.data
	.cc_top before_change.2.data,before_change.2
	.p2align	2
	.type	before_change.2,@object
	.size	before_change.2, 4
before_change.2:
	.long	0
	.cc_bottom before_change.2.data
	.cc_top sequence_before.0.data,sequence_before.0
	.p2align	2
	.type	sequence_before.0,@object
	.size	sequence_before.0, 4
sequence_before.0:
	.long	0
	.cc_bottom sequence_before.0.data
	.cc_top sequence_before.1.data,sequence_before.1
	.p2align	2
	.type	sequence_before.1,@object
	.size	sequence_before.1, 4
sequence_before.1:
	.long	0
	.cc_bottom sequence_before.1.data
	.cc_top sequence_before.2.data,sequence_before.2
	.p2align	2
	.type	sequence_before.2,@object
	.size	sequence_before.2, 4
sequence_before.2:
	.long	0
	.cc_bottom sequence_before.2.data
	.cc_top sequence_before.3.data,sequence_before.3
	.p2align	2
	.type	sequence_before.3,@object
	.size	sequence_before.3, 4
sequence_before.3:
	.long	0
	.cc_bottom sequence_before.3.data
	.cc_top sequence_before.4.data,sequence_before.4
	.p2align	2
	.type	sequence_before.4,@object
	.size	sequence_before.4, 4
sequence_before.4:
	.long	0
	.cc_bottom sequence_before.4.data
	.cc_top sequence_before.5.data,sequence_before.5
	.p2align	2
	.type	sequence_before.5,@object
	.size	sequence_before.5, 4
sequence_before.5:
	.long	0
	.cc_bottom sequence_before.5.data
	.cc_top modulation_before.0.data,modulation_before.0
	.p2align	2
	.type	modulation_before.0,@object
	.size	modulation_before.0, 4
modulation_before.0:
	.long	0
	.cc_bottom modulation_before.0.data
	.cc_top modulation_before.1.data,modulation_before.1
	.p2align	2
	.type	modulation_before.1,@object
	.size	modulation_before.1, 4
modulation_before.1:
	.long	0
	.cc_bottom modulation_before.1.data
	.cc_top modulation_before.2.data,modulation_before.2
	.p2align	2
	.type	modulation_before.2,@object
	.size	modulation_before.2, 4
modulation_before.2:
	.long	0
	.cc_bottom modulation_before.2.data
	.cc_top modulation_before.3.data,modulation_before.3
	.p2align	2
	.type	modulation_before.3,@object
	.size	modulation_before.3, 4
modulation_before.3:
	.long	0
	.cc_bottom modulation_before.3.data
	.cc_top modulation_before.4.data,modulation_before.4
	.p2align	2
	.type	modulation_before.4,@object
	.size	modulation_before.4, 4
modulation_before.4:
	.long	0
	.cc_bottom modulation_before.4.data
	.section	.dp.data,"awd",@progbits
	.cc_top take_event.message.data,take_event.message
	.p2align	2
	.type	take_event.message,@object
	.size	take_event.message, 4
take_event.message:
	.long	play_ring
	.cc_bottom take_event.message.data
	.ident	"Debian clang version 14.0.6"
	.section	".note.GNU-stack","",@progbits
