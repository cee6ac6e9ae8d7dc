# Made by clang from handle.c; do not edit.
# sha256 of it and what it includes: 2ef964dd82ee4e0ba33c6e442cc0f9c835c15ff98fbf81a4d6413a43a0c59bfe
	.text
	.section	.cp.rodata.cst4,"aMc",@progbits,4
	.p2align	2
.LCPI0_0:
	.long	16777216
.LCPI0_1:
	.long	822083583
.LCPI0_2:
	.long	50332416
.LCPI0_3:
	.long	67108864
.LCPI0_4:
	.long	218103807
.LCPI0_5:
	.long	201326591
.LCPI0_6:
	.long	33554431
.LCPI0_7:
	.long	150929408
.LCPI0_8:
	.long	3988292384
.LCPI0_9:
	.long	2452026722
.LCPI0_10:
	.long	16713730
.LCPI0_11:
	.long	134152192
.LCPI0_12:
	.long	16713474
.LCPI0_13:
	.long	286331153
.LCPI0_14:
	.long	4294705151
.LCPI0_15:
	.long	4294639615
	.text
	.globl	handle_message
	.p2align	2
	.type	handle_message,@function
	.cc_top handle_message.function,handle_message
handle_message:
	entsp 18
	stw r4, sp[17]
	stw r5, sp[16]
	stw r6, sp[15]
	stw r7, sp[14]
	stw r8, sp[13]
	stw r9, sp[12]
	stw r10, sp[11]
	ldw r2, dp[number]
	ldc r1, 56
	add r1, r0, r1
	ldw r5, r1[0]
	eq r1, r5, 3
	mkmsk r4, 16
	bf r1, .LBB0_32
	eq r1, r2, r4
	bt r1, .LBB0_32
	ldw r6, r0[0]
	ldw r1, cp[.LCPI0_0]
	lsu r1, r6, r1
	bt r1, .LBB0_56
	shr r11, r6, 8
	zext r11, 16
	shr r3, r6, 24
	add r1, r0, 4
	mov r7, r6
	zext r7, 8
	eq r8, r7, 3
	bt r8, .LBB0_17
	eq r8, r7, 2
	bt r8, .LBB0_9
	eq r0, r7, 1
	bf r0, .LBB0_56
	ldw r0, cp[.LCPI0_6]
	lsu r0, r0, r6
	bt r0, .LBB0_56
	mkmsk r0, 8
	lsu r0, r0, r11
	bt r0, .LBB0_56
	ldc r0, 48
	mul r0, r11, r0
	ldaw r2, dp[slots]
	add r0, r0, r2
	bl slice_copy
	bu .LBB0_57
.LBB0_17:
	ldw r7, cp[.LCPI0_1]
	lsu r7, r7, r6
	bt r7, .LBB0_56
	add r7, r11, r3
	ldc r8, 4096
	lsu r7, r8, r7
	bt r7, .LBB0_56
	ldc r7, 26
	shr r7, r6, r7
	mov r8, r3
	zext r8, 2
	bf r8, .LBB0_20
	ldw r1, r1[r7]
	shl r8, r8, 3
	shr r1, r1, r8
	add r8, r7, 1
	bu .LBB0_22
.LBB0_9:
	ldw r7, cp[.LCPI0_4]
	lsu r7, r7, r6
	bt r7, .LBB0_56
	add r7, r11, r3
	ldc r8, 1024
	lsu r7, r8, r7
	bt r7, .LBB0_56
	ldw r7, cp[.LCPI0_5]
	lsu r6, r7, r6
	bt r6, .LBB0_15
	add r7, r3, 1
	ldc r6, 0
	ldc r8, 13
.LBB0_13:
	ldw r9, r0[r7]
	or r6, r9, r6
	add r7, r7, 1
	eq r9, r7, r8
	bf r9, .LBB0_13
	bt r6, .LBB0_32
.LBB0_15:
	ldaw r0, dp[entries]
	ldaw r0, r0[r11]
.LBB0_16:
	ldw r2, r1[0]
	stw r2, r0[0]
	sub r3, r3, 1
	add r0, r0, 4
	add r1, r1, 4
	bt r3, .LBB0_16
	bu .LBB0_57
.LBB0_20:
	ldc r1, 0
	mov r8, r7
.LBB0_22:
	ldc r9, 11
	lsu r9, r9, r8
	bt r9, .LBB0_25
	add r8, r8, 1
	ldc r9, 13
.LBB0_24:
	ldw r10, r0[r8]
	or r1, r10, r1
	add r8, r8, 1
	eq r10, r8, r9
	bf r10, .LBB0_24
.LBB0_25:
	bf r1, .LBB0_26
.LBB0_32:
	eq r1, r5, 5
	bf r1, .LBB0_52
	eq r1, r2, r4
	bt r1, .LBB0_52
	ldw r0, r0[0]
	ldw r1, dp[time_runs]
	bt r1, .LBB0_36
	mkmsk r1, 1
	stw r1, dp[unsynced]
.LBB0_36:
	ldw r1, dp[state_lock]
	in r1, res[r1]
	ldw r1, dp[handle_clock]
	in r11, res[r1]
	ldw r4, dp[told+32]
	eq r0, r0, 7
	bf r0, .LBB0_41
	ldw r7, dp[told+36]
	ldw r0, dp[damaged]
	ldw r1, dp[damaged_received]
	add r0, r1, r0
	ldw r1, dp[told+40]
	add r8, r0, r1
	ldw r3, dp[told+44]
	ldw r1, dp[told+48]
	ldw r2, dp[told+52]
	ldw r0, dp[told+60]
	ldw r6, dp[told+56]
	ldw r5, dp[state_lock]
	sub r11, r11, r4
	ashr r11, r11, 32
	bt r11, .LBB0_38
	ldaw r11, dp[told+28]
	bu .LBB0_40
.LBB0_52:
	eq r1, r5, 6
	bf r1, .LBB0_56
	eq r1, r2, r4
	bf r1, .LBB0_56
	ldw r0, r0[0]
	ldc r1, 9
	lsu r3, r1, r0
	bt r3, .LBB0_56
	mov r3, r0
	zext r3, 1
	shl r11, r0, 3
	ldc r4, 16
	and r11, r11, r4
	or r3, r11, r3
	shl r11, r0, 6
	ldc r4, 256
	and r11, r11, r4
	or r3, r3, r11
	shl r1, r0, r1
	ldc r11, 4096
	and r1, r1, r11
	or r1, r3, r1
	ldc r3, 4369
	xor r11, r1, r3
	ldw r1, dp[config_end]
	ldc r3, 192
	outct res[r1], r3
	ldw r1, dp[config_end]
	shr r4, r2, 8
	outt res[r1], r4
	ldw r1, dp[config_end]
	zext r2, 8
	outt res[r1], r2
	ldw r1, dp[config_end]
	shr r2, r1, 8
	zext r2, 8
	outt res[r1], r2
	ldw r2, dp[config_end]
	ldc r1, 0
	outt res[r2], r1
	ldw r2, dp[config_end]
	ldc r4, 12
	outt res[r2], r4
	ldw r2, dp[config_end]
	out res[r2], r11
	ldw r11, dp[config_end]
	mkmsk r2, 1
	outct res[r11], r2
	ldw r11, dp[config_end]
	inct r11, res[r11]
	ldw r11, dp[config_end]
	inct r11, res[r11]
	ldw r11, dp[number]
	ldw r4, dp[config_end]
	outct res[r4], r3
	ldw r4, dp[config_end]
	shr r5, r11, 8
	outt res[r4], r5
	ldw r4, dp[config_end]
	zext r11, 8
	outt res[r4], r11
	ldw r11, dp[config_end]
	shr r4, r11, 8
	zext r4, 8
	outt res[r11], r4
	ldw r11, dp[config_end]
	outt res[r11], r1
	ldw r11, dp[config_end]
	ldc r4, 13
	outt res[r11], r4
	ldw r11, dp[config_end]
	ldw r4, cp[.LCPI0_13]
	out res[r11], r4
	ldw r11, dp[config_end]
	outct res[r11], r2
	ldw r11, dp[config_end]
	inct r11, res[r11]
	ldw r11, dp[config_end]
	inct r11, res[r11]
	ldw r11, dp[config_end]
	outct res[r11], r3
	ldw r3, dp[config_end]
	shr r11, r0, 8
	outt res[r3], r11
	ldw r3, dp[config_end]
	outt res[r3], r0
	ldw r3, dp[config_end]
	shr r11, r3, 8
	zext r11, 8
	outt res[r3], r11
	ldw r3, dp[config_end]
	outt res[r3], r1
	ldw r3, dp[config_end]
	ldc r11, 5
	outt res[r3], r11
	ldw r3, dp[config_end]
	out res[r3], r0
	ldw r3, dp[config_end]
	outct res[r3], r2
	ldw r3, dp[config_end]
	inct r3, res[r3]
	ldw r3, dp[config_end]
	inct r3, res[r3]
	ldw r11, dp[config_end]
	shl r3, r0, 16
	ldc r4, 49932
	or r4, r3, r4
	setd res[r11], r4
	ldw r11, dp[receive_play]
	ldaw r4, dp[play_inbox]
	ld16s r4, r4[r1]
	zext r4, 16
	or r4, r4, r3
	setd res[r11], r4
	ldw r11, dp[play_ready]
	ldaw r4, dp[receive_play_ready]
	ld16s r4, r4[r1]
	zext r4, 16
	or r4, r4, r3
	setd res[r11], r4
	ldw r11, dp[receive_handle]
	ldaw r4, dp[handle_inbox]
	ld16s r4, r4[r1]
	zext r4, 16
	or r4, r4, r3
	setd res[r11], r4
	ldw r11, dp[handle_ready]
	ldaw r4, dp[receive_handle_ready]
	ld16s r4, r4[r1]
	zext r4, 16
	or r4, r4, r3
	setd res[r11], r4
	ldw r11, dp[started_from]
	ldaw r4, dp[started_to]
	ld16s r4, r4[r1]
	zext r4, 16
	or r3, r4, r3
	setd res[r11], r3
	shl r3, r0, 8
	ldw r11, cp[.LCPI0_8]
	ldw r4, cp[.LCPI0_9]
	crc8 r4, r5, r1, r11
	crc8 r4, r5, r0, r11
	mkmsk r5, 2
	crc8 r4, r11, r5, r11
	stw r4, dp[load_crc]
	ldw r11, cp[.LCPI0_14]
	andnot r11, r3
	stw r11, dp[program_crc]
	ldw r11, cp[.LCPI0_15]
	andnot r11, r3
	stw r11, dp[collect_crc]
	stw r0, dp[number]
	ldaw r0, dp[waits_for_link]
	st8 r2, r0[r1]
	bl handle_identity
	bu .LBB0_57
.LBB0_56:
	ldw r0, dp[damaged]
	add r0, r0, 1
	stw r0, dp[damaged]
.LBB0_57:
	ldw r10, sp[11]
	ldw r9, sp[12]
	ldw r8, sp[13]
	ldw r7, sp[14]
	ldw r6, sp[15]
	ldw r5, sp[16]
	ldw r4, sp[17]
	retsp 18
.LBB0_41:
	sub r0, r11, r4
	ashr r0, r0, 32
	bt r0, .LBB0_42
	ldaw r1, dp[told+16]
	bu .LBB0_44
.LBB0_38:
	ldaw r11, dp[told+12]
.LBB0_40:
	ldw r10, r11[0]
	out res[r5], r5
	ldw r11, dp[told_overruns]
	eq r11, r1, r11
	eq r11, r11, 0
	mov r4, r0
	zext r4, 8
	stw r4, sp[5]
	mov r4, r6
	zext r4, 8
	stw r4, sp[10]
	stw r7, sp[1]
	add r4, r8, r7
	add r3, r4, r3
	ldw r4, dp[told_chain]
	eq r4, r3, r4
	eq r4, r4, 0
	or r2, r2, r4
	shl r11, r11, 5
	or r2, r2, r11
	ldw r11, dp[unsynced]
	eq r11, r11, 0
	eq r11, r11, 0
	shl r11, r11, 2
	or r4, r2, r11
	stw r3, dp[told_chain]
	stw r1, dp[told_overruns]
	ldw r9, dp[number]
	ldc r2, 0
	ldaw r1, dp[answer+4]
	st8 r9, r1[r2]
	zext r9, 8
	mkmsk r3, 1
	st8 r0, r1[r3]
	ldc r0, 2
	st8 r4, r1[r0]
	mkmsk r5, 2
	st8 r2, r1[r5]
	ldaw r11, cp[firmware_version]
	mov r1, r11
	ldaw r7, dp[answer+8]
	mov r0, r7
	mov r2, r5
	bl memcpy
	st8 r6, r7[r5]
	ldaw r1, dp[answer+12]
	ldw r11, sp[1]
	ldc r6, 0
	st8 r10, r1[r6]
	shr r7, r10, 8
	mkmsk r2, 1
	st8 r7, r1[r2]
	shr r3, r10, 16
	stw r3, sp[2]
	ldc r0, 2
	st8 r3, r1[r0]
	shr r3, r10, 24
	stw r3, sp[4]
	st8 r3, r1[r5]
	ldaw r1, dp[answer+16]
	st8 r11, r1[r6]
	shr r3, r11, 8
	stw r3, sp[3]
	st8 r3, r1[r2]
	shr r3, r11, 16
	stw r3, sp[6]
	st8 r3, r1[r0]
	shr r3, r11, 24
	stw r3, sp[7]
	st8 r3, r1[r5]
	ldaw r1, dp[answer+20]
	st8 r8, r1[r6]
	mov r3, r8
	shr r6, r3, 8
	st8 r6, r1[r2]
	shr r2, r3, 16
	stw r2, sp[8]
	st8 r2, r1[r0]
	mov r8, r0
	shr r2, r3, 24
	stw r2, sp[9]
	st8 r2, r1[r5]
	ldw r1, cp[.LCPI0_11]
	stw r1, dp[answer]
	ldw r2, cp[.LCPI0_8]
	ldw r1, cp[.LCPI0_9]
	ldc r0, 0
	crc8 r1, r5, r0, r2
	mkmsk r5, 8
	crc8 r1, r5, r5, r2
	mkmsk r5, 3
	crc8 r1, r5, r5, r2
	crc8 r1, r5, r9, r2
	ldw r5, sp[5]
	crc8 r1, r5, r5, r2
	zext r4, 8
	crc8 r1, r4, r4, r2
	mov r5, r0
	crc8 r1, r4, r5, r2
	ldaw r0, dp[answer+8]
	ld8u r4, r0[r5]
	crc8 r1, r4, r4, r2
	mkmsk r9, 1
	ld8u r4, r0[r9]
	crc8 r1, r4, r4, r2
	ld8u r4, r0[r8]
	crc8 r1, r4, r4, r2
	ldw r4, sp[10]
	crc8 r1, r4, r4, r2
	zext r10, 8
	crc8 r1, r4, r10, r2
	zext r7, 8
	crc8 r1, r4, r7, r2
	ldw r0, sp[2]
	zext r0, 8
	crc8 r1, r0, r0, r2
	ldw r0, sp[4]
	crc8 r1, r0, r0, r2
	zext r11, 8
	crc8 r1, r0, r11, r2
	ldw r0, sp[3]
	zext r0, 8
	crc8 r1, r0, r0, r2
	ldw r0, sp[6]
	zext r0, 8
	crc8 r1, r0, r0, r2
	ldw r0, sp[7]
	crc8 r1, r0, r0, r2
	zext r3, 8
	crc8 r1, r0, r3, r2
	zext r6, 8
	crc8 r1, r0, r6, r2
	ldw r0, sp[8]
	zext r0, 8
	crc8 r1, r0, r0, r2
	ldw r0, sp[9]
	crc8 r1, r0, r0, r2
	crc32 r1, r5, r2
	not r0, r1
	stw r0, dp[answer+24]
	ldw r0, dp[answer_end]
	ldw r1, cp[.LCPI0_12]
	setd res[r0], r1
	ldw r0, dp[answer_end]
	ldw r1, dp[answer+4]
	byterev r1, r1
	out res[r0], r1
	ldw r0, dp[answer_end]
	ldw r1, dp[answer+8]
	byterev r1, r1
	out res[r0], r1
	ldw r0, dp[answer_end]
	ldw r1, dp[answer+12]
	byterev r1, r1
	out res[r0], r1
	ldw r0, dp[answer_end]
	ldw r1, dp[answer+16]
	byterev r1, r1
	out res[r0], r1
	ldw r0, dp[answer_end]
	ldw r1, dp[answer+20]
	byterev r1, r1
	out res[r0], r1
	ldw r0, dp[answer_end]
	ldw r1, dp[answer+24]
	byterev r1, r1
	out res[r0], r1
	ldw r0, dp[answer_end]
	outct res[r0], r9
	bu .LBB0_57
.LBB0_42:
	ldaw r1, dp[told]
.LBB0_44:
	ldw r5, r1[1]
	ldw r6, r1[0]
	bt r0, .LBB0_45
	ldaw r0, dp[told+24]
	bu .LBB0_47
.LBB0_45:
	ldaw r0, dp[told+8]
.LBB0_47:
	ldw r1, r0[0]
	ldw r0, dp[state_lock]
	out res[r0], r0
	ldw r11, dp[number]
	ldc r4, 0
	ldaw r7, dp[answer+4]
	st8 r11, r7[r4]
	zext r11, 8
	mkmsk r0, 1
	st8 r6, r7[r0]
	shr r3, r6, 8
	ldc r2, 2
	st8 r3, r7[r2]
	shr r8, r6, 16
	mkmsk r3, 2
	st8 r8, r7[r3]
	shr r6, r6, 24
	ldaw r7, dp[answer+8]
	st8 r6, r7[r4]
	st8 r5, r7[r0]
	shr r6, r5, 8
	st8 r6, r7[r2]
	shr r6, r5, 16
	st8 r6, r7[r3]
	shr r6, r5, 24
	ldaw r5, dp[answer+12]
	st8 r6, r5[r4]
	ldaw r6, dp[answer+16]
	ldc r7, 48
.LBB0_48:
	add r8, r1, r4
	ldw r8, r8[0]
	add r9, r5, r4
	st8 r8, r9[r0]
	shr r10, r8, 8
	st8 r10, r9[r2]
	shr r10, r8, 16
	st8 r10, r9[r3]
	shr r8, r8, 24
	st8 r8, r4[r6]
	add r4, r4, 4
	eq r8, r4, r7
	bf r8, .LBB0_48
	ldw r1, cp[.LCPI0_7]
	stw r1, dp[answer]
	ldc r1, 0
	ldw r4, cp[.LCPI0_8]
	ldw r5, cp[.LCPI0_9]
	crc8 r5, r6, r1, r4
	mkmsk r6, 8
	crc8 r5, r6, r6, r4
	ldc r6, 8
	crc8 r5, r6, r6, r4
	crc8 r5, r11, r11, r4
	ldc r11, 5
	ldaw r6, dp[answer]
	ldc r7, 61
.LBB0_50:
	ld8u r8, r11[r6]
	crc8 r5, r8, r8, r4
	add r11, r11, 1
	eq r8, r11, r7
	bf r8, .LBB0_50
	crc32 r5, r1, r4
	not r11, r5
	ldaw r4, dp[answer+60]
	st8 r11, r4[r0]
	shr r5, r11, 8
	st8 r5, r4[r2]
	shr r2, r11, 16
	st8 r2, r4[r3]
	shr r3, r11, 24
	ldaw r2, dp[answer+64]
	st8 r3, r2[r1]
	ldw r3, dp[answer_end]
	ldw r11, cp[.LCPI0_10]
	setd res[r3], r11
	ldw r3, dp[answer_end]
	ldw r11, dp[answer+4]
	byterev r11, r11
	out res[r3], r11
	ldw r3, dp[answer_end]
	ldw r11, dp[answer+8]
	byterev r11, r11
	out res[r3], r11
	ldw r3, dp[answer_end]
	ldw r11, dp[answer+12]
	byterev r11, r11
	out res[r3], r11
	ldw r3, dp[answer_end]
	ldw r11, dp[answer+16]
	byterev r11, r11
	out res[r3], r11
	ldw r3, dp[answer_end]
	ldw r11, dp[answer+20]
	byterev r11, r11
	out res[r3], r11
	ldw r3, dp[answer_end]
	ldw r11, dp[answer+24]
	byterev r11, r11
	out res[r3], r11
	ldw r3, dp[answer_end]
	ldw r11, dp[answer+28]
	byterev r11, r11
	out res[r3], r11
	ldw r3, dp[answer_end]
	ldw r11, dp[answer+32]
	byterev r11, r11
	out res[r3], r11
	ldw r3, dp[answer_end]
	ldw r11, dp[answer+36]
	byterev r11, r11
	out res[r3], r11
	ldw r3, dp[answer_end]
	ldw r11, dp[answer+40]
	byterev r11, r11
	out res[r3], r11
	ldw r3, dp[answer_end]
	ldw r11, dp[answer+44]
	byterev r11, r11
	out res[r3], r11
	ldw r3, dp[answer_end]
	ldw r11, dp[answer+48]
	byterev r11, r11
	out res[r3], r11
	ldw r3, dp[answer_end]
	ldw r11, dp[answer+52]
	byterev r11, r11
	out res[r3], r11
	ldw r3, dp[answer_end]
	ldw r11, dp[answer+56]
	byterev r11, r11
	out res[r3], r11
	ldw r3, dp[answer_end]
	ldw r11, dp[answer+60]
	byterev r11, r11
	out res[r3], r11
	ldw r3, dp[answer_end]
	ld8u r1, r2[r1]
	outt res[r3], r1
	ldw r1, dp[answer_end]
	outct res[r1], r0
	bu .LBB0_57
.LBB0_26:
	ldw r1, cp[.LCPI0_2]
	and r1, r6, r1
	bf r1, .LBB0_27
	ldaw r1, dp[samples]
	add r1, r11, r1
	add r0, r0, 4
	ldc r2, 0
.LBB0_31:
	ld8u r11, r0[r2]
	st8 r11, r1[r2]
	sub r3, r3, 1
	add r1, r1, 1
	add r0, r0, 1
	bt r3, .LBB0_31
	bu .LBB0_57
.LBB0_27:
	ldw r1, cp[.LCPI0_3]
	lsu r1, r6, r1
	bt r1, .LBB0_57
	ldaw r1, dp[samples]
	add r1, r11, r1
	add r0, r0, 4
.LBB0_29:
	ldw r2, r0[0]
	stw r2, r1[0]
	sub r7, r7, 1
	add r1, r1, 4
	add r0, r0, 4
	bt r7, .LBB0_29
	bu .LBB0_57
	.cc_bottom handle_message.function
.Lfunc_end0:
	.size	handle_message, .Lfunc_end0-handle_message

	.section	.cp.rodata.cst4,"aMc",@progbits,4
	.p2align	2
.LCPI1_0:
	.long	167706624
.LCPI1_1:
	.long	3988292384
.LCPI1_2:
	.long	2452026722
.LCPI1_3:
	.long	16713986
	.text
	.globl	handle_identity
	.p2align	2
	.type	handle_identity,@function
	.cc_top handle_identity.function,handle_identity
handle_identity:
	entsp 11
	stw r4, sp[10]
	stw r5, sp[9]
	stw r6, sp[8]
	stw r7, sp[7]
	stw r8, sp[6]
	stw r9, sp[5]
	stw r10, sp[4]
	ldc r4, 0
	ldaw r1, dp[waits_for_link]
	ld8u r0, r1[r4]
	bf r0, .LBB1_5
	ldaw r0, dp[linked]
	ld8u r0, r0[r4]
	ldw r7, dp[number]
	eq r2, r7, 9
	bt r0, .LBB1_4
	bt r2, .LBB1_4
	ldw r3, dp[ms]
	ldc r11, 1000
	lsu r3, r3, r11
	bt r3, .LBB1_5
.LBB1_4:
	st8 r4, r1[r4]
	ldaw r1, dp[identified]
	mkmsk r3, 1
	st8 r3, r1[r4]
	ldaw r6, dp[answer+4]
	st8 r7, r6[r4]
	eq r0, r0, 0
	or r0, r0, r2
	stw r0, sp[1]
	st8 r0, r6[r3]
	mov r5, r3
	ldaw r11, cp[firmware_version]
	mov r1, r11
	add r0, r6, 2
	mkmsk r8, 2
	mov r2, r8
	bl memcpy
	ldw r6, dp[unique_id]
	ldaw r3, dp[answer+8]
	mov r2, r5
	st8 r6, r3[r2]
	shr r5, r6, 8
	ldc r1, 2
	st8 r5, r3[r1]
	shr r0, r6, 16
	mov r11, r8
	st8 r0, r3[r11]
	shr r8, r6, 24
	stw r8, sp[2]
	ldaw r3, dp[answer+12]
	st8 r8, r3[r4]
	ldw r10, dp[unique_id+4]
	st8 r10, r3[r2]
	shr r9, r10, 8
	st8 r9, r3[r1]
	shr r8, r10, 16
	st8 r8, r3[r11]
	shr r3, r10, 24
	stw r3, sp[3]
	ldaw r2, dp[answer+16]
	st8 r3, r2[r4]
	ldw r3, cp[.LCPI1_0]
	stw r3, dp[answer]
	ldw r11, cp[.LCPI1_1]
	ldw r3, cp[.LCPI1_2]
	crc8 r3, r2, r4, r11
	mkmsk r2, 8
	crc8 r3, r2, r2, r11
	ldc r2, 9
	crc8 r3, r2, r2, r11
	zext r7, 8
	crc8 r3, r2, r7, r11
	ldw r2, sp[1]
	crc8 r3, r2, r2, r11
	mov r7, r4
	ldaw r4, dp[answer+4]
	ld8u r2, r4[r1]
	crc8 r3, r2, r2, r11
	mkmsk r1, 2
	ld8u r2, r4[r1]
	crc8 r3, r2, r2, r11
	ldaw r1, dp[answer+8]
	ld8u r2, r1[r7]
	crc8 r3, r2, r2, r11
	zext r6, 8
	crc8 r3, r2, r6, r11
	zext r5, 8
	crc8 r3, r2, r5, r11
	zext r0, 8
	crc8 r3, r0, r0, r11
	ldw r0, sp[2]
	crc8 r3, r0, r0, r11
	zext r10, 8
	crc8 r3, r0, r10, r11
	zext r9, 8
	crc8 r3, r0, r9, r11
	zext r8, 8
	crc8 r3, r0, r8, r11
	ldw r0, sp[3]
	crc8 r3, r0, r0, r11
	crc32 r3, r7, r11
	not r0, r3
	mkmsk r3, 1
	ldaw r2, dp[answer+16]
	st8 r0, r2[r3]
	shr r1, r0, 8
	ldc r11, 2
	st8 r1, r2[r11]
	mov r11, r2
	shr r1, r0, 16
	mkmsk r2, 2
	st8 r1, r11[r2]
	shr r1, r0, 24
	ldaw r0, dp[answer+20]
	st8 r1, r0[r7]
	ldw r1, dp[answer_end]
	ldw r2, cp[.LCPI1_3]
	setd res[r1], r2
	ldw r1, dp[answer_end]
	ldw r2, dp[answer+4]
	byterev r2, r2
	out res[r1], r2
	ldw r1, dp[answer_end]
	ldw r2, dp[answer+8]
	byterev r2, r2
	out res[r1], r2
	ldw r1, dp[answer_end]
	ldw r2, dp[answer+12]
	byterev r2, r2
	out res[r1], r2
	ldw r1, dp[answer_end]
	ldw r2, dp[answer+16]
	byterev r2, r2
	out res[r1], r2
	ldw r1, dp[answer_end]
	ld8u r0, r0[r7]
	outt res[r1], r0
	ldw r0, dp[answer_end]
	outct res[r0], r3
.LBB1_5:
	ldw r10, sp[4]
	ldw r9, sp[5]
	ldw r8, sp[6]
	ldw r7, sp[7]
	ldw r6, sp[8]
	ldw r5, sp[9]
	ldw r4, sp[10]
	retsp 11
	.cc_bottom handle_identity.function
.Lfunc_end1:
	.size	handle_identity, .Lfunc_end1-handle_identity

	.globl	handle_begin
	.p2align	2
	.type	handle_begin,@function
	.cc_top handle_begin.function,handle_begin
handle_begin:
	extsp 1
	stw r4, sp[0]
	ldw r0, dp[number]
	ldw r1, dp[config_end]
	shl r0, r0, 16
	ldc r2, 49932
	or r0, r0, r2
	setd res[r1], r0
	ldw r0, dp[number]
	shl r1, r0, 16
	ldw r2, dp[receive_play]
	ldaw r3, dp[play_inbox]
	ldc r0, 0
	ld16s r3, r3[r0]
	zext r3, 16
	or r3, r3, r1
	setd res[r2], r3
	ldw r2, dp[play_ready]
	ldaw r3, dp[receive_play_ready]
	ld16s r3, r3[r0]
	zext r3, 16
	or r3, r3, r1
	setd res[r2], r3
	ldw r2, dp[receive_handle]
	ldaw r3, dp[handle_inbox]
	ld16s r3, r3[r0]
	zext r3, 16
	or r3, r3, r1
	setd res[r2], r3
	ldw r2, dp[handle_ready]
	ldaw r3, dp[receive_handle_ready]
	ld16s r3, r3[r0]
	zext r3, 16
	or r3, r3, r1
	setd res[r2], r3
	ldw r2, dp[started_from]
	ldaw r3, dp[started_to]
	ld16s r3, r3[r0]
	zext r3, 16
	or r1, r3, r1
	setd res[r2], r1
	ldw r1, dp[number]
	ldw r2, dp[config_end]
	ldc r3, 193
	outct res[r2], r3
	ldw r2, dp[config_end]
	shr r3, r1, 8
	outt res[r2], r3
	ldw r2, dp[config_end]
	zext r1, 8
	outt res[r2], r1
	ldw r1, dp[config_end]
	shr r2, r1, 8
	zext r2, 8
	outt res[r1], r2
	ldw r1, dp[config_end]
	outt res[r1], r0
	ldw r1, dp[config_end]
	ldc r2, 128
	outt res[r1], r2
	ldw r2, dp[config_end]
	mkmsk r1, 1
	outct res[r2], r1
	ldw r2, dp[config_end]
	inct r2, res[r2]
	eq r3, r2, 3
	mov r2, r0
	bf r3, .LBB2_2
	ldw r2, dp[config_end]
	in r2, res[r2]
.LBB2_2:
	ldw r3, dp[config_end]
	inct r3, res[r3]
	stw r2, dp[link_setup]
	ldw r3, dp[number]
	ldw r11, dp[config_end]
	ldc r2, 192
	outct res[r11], r2
	ldw r11, dp[config_end]
	shr r4, r3, 8
	outt res[r11], r4
	ldw r11, dp[config_end]
	zext r3, 8
	outt res[r11], r3
	ldw r3, dp[config_end]
	shr r11, r3, 8
	zext r11, 8
	outt res[r3], r11
	ldw r3, dp[config_end]
	outt res[r3], r0
	ldw r3, dp[config_end]
	ldc r11, 12
	outt res[r3], r11
	ldw r3, dp[config_end]
	out res[r3], r0
	ldw r3, dp[config_end]
	outct res[r3], r1
	ldw r3, dp[config_end]
	inct r3, res[r3]
	ldw r3, dp[config_end]
	inct r3, res[r3]
	ldw r3, dp[number]
	ldw r11, dp[config_end]
	outct res[r11], r2
	ldw r11, dp[config_end]
	shr r4, r3, 8
	outt res[r11], r4
	ldw r11, dp[config_end]
	zext r3, 8
	outt res[r11], r3
	ldw r3, dp[config_end]
	shr r11, r3, 8
	zext r11, 8
	outt res[r3], r11
	ldw r3, dp[config_end]
	outt res[r3], r0
	ldw r3, dp[config_end]
	ldc r11, 13
	outt res[r3], r11
	ldw r3, dp[config_end]
	out res[r3], r0
	ldw r3, dp[config_end]
	outct res[r3], r1
	ldw r3, dp[config_end]
	inct r3, res[r3]
	ldw r3, dp[config_end]
	inct r3, res[r3]
	ldw r3, dp[number]
	ldw r11, dp[config_end]
	outct res[r11], r2
	ldw r2, dp[config_end]
	shr r11, r3, 8
	outt res[r2], r11
	ldw r2, dp[config_end]
	zext r3, 8
	outt res[r2], r3
	ldw r2, dp[config_end]
	shr r3, r2, 8
	zext r3, 8
	outt res[r2], r3
	ldw r2, dp[config_end]
	outt res[r2], r0
	ldw r0, dp[config_end]
	ldc r2, 33
	outt res[r0], r2
	ldw r0, dp[config_end]
	ldc r2, 256
	out res[r0], r2
	ldw r0, dp[config_end]
	outct res[r0], r1
	ldw r0, dp[config_end]
	inct r0, res[r0]
	ldw r0, dp[config_end]
	inct r0, res[r0]
	ldw r4, sp[0]
	ldaw sp, sp[1]
	retsp 0
	.cc_bottom handle_begin.function
.Lfunc_end2:
	.size	handle_begin, .Lfunc_end2-handle_begin

	.section	.cp.rodata.cst4,"aMc",@progbits,4
	.p2align	2
.LCPI3_0:
	.long	1077936127
.LCPI3_1:
	.long	2164260864
.LCPI3_2:
	.long	33554432
.LCPI3_3:
	.long	100000
.LCPI3_4:
	.long	1073741824
	.text
	.globl	handle
	.p2align	2
	.type	handle,@function
	.cc_top handle.function,handle
handle:
	entsp 8
	stw r4, sp[7]
	stw r5, sp[6]
	stw r6, sp[5]
	stw r7, sp[4]
	stw r8, sp[3]
	stw r9, sp[2]
	stw r10, sp[1]
	ldw r0, dp[handle_clock]
	in r4, res[r0]
	bl handle_events
	ldaw r9, dp[handle_ring]
	ldc r7, 0
	ldaw r8, dp[linked]
	ldc r6, 129
	mkmsk r10, 1
	ldw r5, cp[.LCPI3_4]
	bu .LBB3_1
.LBB3_5:
	add r4, r4, r5
.LBB3_1:
	mov r0, r4
	bl handle_wait
	eq r0, r0, 1
	bt r0, .LBB3_2
	ld8u r0, r8[r7]
	bt r0, .LBB3_5
	ldaw r0, dp[identified]
	ld8u r0, r0[r7]
	bt r0, .LBB3_5
	ldw r0, dp[number]
	ldw r1, dp[link_setup]
	ldw r2, cp[.LCPI3_0]
	and r1, r1, r2
	ldw r2, cp[.LCPI3_1]
	or r1, r1, r2
	ldw r2, dp[config_end]
	ldc r3, 192
	outct res[r2], r3
	ldw r2, dp[config_end]
	shr r3, r0, 8
	outt res[r2], r3
	ldw r2, dp[config_end]
	zext r0, 8
	outt res[r2], r0
	ldw r0, dp[config_end]
	shr r2, r0, 8
	zext r2, 8
	outt res[r0], r2
	ldw r0, dp[config_end]
	outt res[r0], r7
	ldw r0, dp[config_end]
	outt res[r0], r6
	ldw r0, dp[config_end]
	out res[r0], r1
	ldw r0, dp[config_end]
	outct res[r0], r10
	ldw r0, dp[config_end]
	inct r0, res[r0]
	ldw r0, dp[config_end]
	inct r0, res[r0]
	ldw r0, dp[number]
	ldw r1, dp[config_end]
	ldc r2, 193
	outct res[r1], r2
	ldw r1, dp[config_end]
	shr r2, r0, 8
	outt res[r1], r2
	ldw r1, dp[config_end]
	zext r0, 8
	outt res[r1], r0
	ldw r0, dp[config_end]
	shr r1, r0, 8
	zext r1, 8
	outt res[r0], r1
	ldw r0, dp[config_end]
	outt res[r0], r7
	ldw r0, dp[config_end]
	outt res[r0], r6
	ldw r0, dp[config_end]
	outct res[r0], r10
	ldw r0, dp[config_end]
	inct r0, res[r0]
	eq r1, r0, 3
	mov r0, r7
	bf r1, .LBB3_8
	ldw r0, dp[config_end]
	in r0, res[r0]
	ldw r1, cp[.LCPI3_2]
	and r0, r0, r1
	ldc r1, 25
	shr r0, r0, r1
.LBB3_8:
	ldw r1, dp[config_end]
	inct r1, res[r1]
	st8 r0, r8[r7]
	bl handle_identity
	ldw r0, dp[ms]
	add r0, r0, 1
	stw r0, dp[ms]
	ldw r0, cp[.LCPI3_3]
	add r4, r4, r0
	bu .LBB3_1
.LBB3_2:
	ldw r0, dp[handle_inbox]
	chkct res[r0], 1
	mov r0, r9
	bl handle_message
	ldc r0, 60
	add r0, r9, r0
	ldw r9, r0[0]
	ldw r0, dp[handle_ready]
	outct res[r0], 1
	bu .LBB3_1
	.cc_bottom handle.function
.Lfunc_end3:
	.size	handle, .Lfunc_end3-handle

	.section	.dp.data,"awd",@progbits
	.cc_top number.data,number
	.globl	number
	.p2align	2
	.type	number,@object
	.size	number, 4
number:
	.long	65535
	.cc_bottom number.data
	.section	.dp.bss,"awd",@nobits
	.cc_top waits_for_link.data,waits_for_link
	.p2align	2
	.type	waits_for_link,@object
	.size	waits_for_link, 1
waits_for_link:
	.byte	0
	.space	3
	.cc_bottom waits_for_link.data
	.cc_top damaged.data,damaged
	.p2align	2
	.type	damaged,@object
	.size	damaged, 4
damaged:
	.long	0
	.cc_bottom damaged.data
	.cc_top linked.data,linked
	.p2align	2
	.type	linked,@object
	.size	linked, 1
linked:
	.byte	0
	.space	3
	.cc_bottom linked.data
	.cc_top ms.data,ms
	.p2align	2
	.type	ms,@object
	.size	ms, 4
ms:
	.long	0
	.cc_bottom ms.data
	.cc_top link_setup.data,link_setup
	.p2align	2
	.type	link_setup,@object
	.size	link_setup, 4
link_setup:
	.long	0
	.cc_bottom link_setup.data
	.cc_top identified.data,identified
	.p2align	2
	.type	identified,@object
	.size	identified, 1
identified:
	.byte	0
	.space	3
	.cc_bottom identified.data
	.cc_top load_crc.data,load_crc
	.globl	load_crc
	.p2align	2
	.type	load_crc,@object
	.size	load_crc, 4
load_crc:
	.long	0
	.cc_bottom load_crc.data
	.cc_top program_crc.data,program_crc
	.globl	program_crc
	.p2align	2
	.type	program_crc,@object
	.size	program_crc, 4
program_crc:
	.long	0
	.cc_bottom program_crc.data
	.cc_top collect_crc.data,collect_crc
	.globl	collect_crc
	.p2align	2
	.type	collect_crc,@object
	.size	collect_crc, 4
collect_crc:
	.long	0
	.cc_bottom collect_crc.data
	.cc_top told_chain.data,told_chain
	.p2align	2
	.type	told_chain,@object
	.size	told_chain, 4
told_chain:
	.long	0
	.cc_bottom told_chain.data
	.cc_top told_overruns.data,told_overruns
	.p2align	2
	.type	told_overruns,@object
	.size	told_overruns, 4
told_overruns:
	.long	0
	.cc_bottom told_overruns.data
	.cc_top answer.data,answer
	.p2align	2
	.type	answer,@object
	.size	answer, 68
answer:
	.space	68
	.cc_bottom answer.data
	.ident	"Debian clang version 14.0.6"
	.section	".note.GNU-stack","",@progbits
