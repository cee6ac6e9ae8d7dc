# Made by clang from blk.c; do not edit.
# sha256 of it and what it includes: 0e9853b3137238b13bcab8b1d5f1b103a9da4a81be03e2a3f14fbdd3cd647e73
	.text
	.globl	pw_block_check
	.p2align	2
	.type	pw_block_check,@function
	.cc_top pw_block_check.function,pw_block_check
pw_block_check:
	entsp 15
	stw r4, sp[14]
	stw r5, sp[13]
	stw r6, sp[12]
	stw r7, sp[11]
	stw r8, sp[10]
	stw r9, sp[9]
	mov r4, r2
	mov r6, r0
	ldc r0, 512
	eq r0, r1, r0
	bf r0, .LBB0_1
	ldc r2, 28
	ld8u r0, r6[r2]
	ldc r1, 29
	ld8u r1, r6[r1]
	shl r1, r1, 8
	ldc r3, 30
	ld8u r3, r6[r3]
	mkmsk r11, 5
	ld8u r11, r6[r11]
	shl r11, r11, 24
	shl r3, r3, 16
	or r0, r1, r0
	or r0, r0, r3
	or r8, r0, r11
	ldaw r7, sp[1]
	mov r0, r7
	mov r1, r6
	bl memcpy
	ldc r5, 0
	stw r5, sp[8]
	ldc r2, 32
	mov r0, r5
	mov r1, r7
	bl pw_crc32
	ldaw r1, r6[8]
	ldc r2, 480
	bl pw_crc32
	eq r0, r8, r0
	bf r0, .LBB0_3
	ld8u r0, r6[r5]
	mkmsk r7, 2
	ldc r1, 80
	eq r0, r0, r1
	bf r0, .LBB0_18
	mkmsk r0, 1
	ld8u r0, r6[r0]
	ldc r1, 87
	eq r0, r0, r1
	bf r0, .LBB0_18
	ldc r0, 2
	ld8u r0, r6[r0]
	eq r0, r0, 1
	bf r0, .LBB0_7
	mkmsk r0, 2
	ld8u r9, r6[r0]
	sub r0, r9, 10
	zext r0, 8
	ldc r1, 247
	lsu r0, r0, r1
	bf r0, .LBB0_10
	ldc r7, 5
	bu .LBB0_18
.LBB0_1:
	mkmsk r7, 1
	bu .LBB0_18
.LBB0_3:
	ldc r7, 2
.LBB0_18:
	mov r0, r7
	ldw r9, sp[9]
	ldw r8, sp[10]
	ldw r7, sp[11]
	ldw r6, sp[12]
	ldw r5, sp[13]
	ldw r4, sp[14]
	retsp 15
.LBB0_7:
	ldc r7, 4
	bu .LBB0_18
.LBB0_10:
	ldaw r11, cp[rules]
	mov r8, r11
	ldaw r1, sp[1]
	mov r0, r6
	bl fields_get
	ldc r0, 24
	ld8u r0, r6[r0]
	ldc r1, 25
	ld8u r1, r6[r1]
	or r0, r0, r1
	ldc r7, 6
	bt r0, .LBB0_18
	ldc r0, 12
	mul r0, r9, r0
	add r6, r0, r8
	ldaw r1, sp[1]
	mov r0, r6
	bl items_valid
	bf r0, .LBB0_18
	ldaw r1, sp[1]
	mov r0, r6
	bl others_valid
	bf r0, .LBB0_18
	ldaw r1, sp[1]
	mov r0, r6
	bl payload_valid
	bf r0, .LBB0_18
	sub r0, r9, 3
	zext r0, 8
	ldc r1, 254
	lsu r0, r0, r1
	bt r0, .LBB0_17
	ldw r0, sp[7]
	ldc r1, 320
	bl pw_pulses_valid
	bf r0, .LBB0_16
.LBB0_17:
	ldaw r1, sp[1]
	ldc r2, 28
	mov r0, r4
	bl __memcpy_4
	mov r7, r5
	bu .LBB0_18
.LBB0_16:
	mkmsk r7, 3
	bu .LBB0_18
	.cc_bottom pw_block_check.function
.Lfunc_end0:
	.size	pw_block_check, .Lfunc_end0-pw_block_check

	.p2align	2
	.type	fields_get,@function
	.cc_top fields_get.function,fields_get
fields_get:
	extsp 3
	stw r4, sp[2]
	stw r5, sp[1]
	stw r6, sp[0]
	mkmsk r2, 2
	ld8u r3, r0[r2]
	ldc r2, 0
	st8 r3, r1[r2]
	ldc r3, 4
	ld8u r3, r0[r3]
	ldc r11, 5
	ld8u r11, r0[r11]
	shl r11, r11, 8
	ldc r4, 6
	ld8u r4, r0[r4]
	mkmsk r5, 3
	ld8u r5, r0[r5]
	shl r5, r5, 24
	shl r4, r4, 16
	or r3, r11, r3
	or r3, r3, r4
	or r3, r3, r5
	stw r3, r1[1]
	ldc r3, 8
	ld8u r3, r0[r3]
	ldc r11, 9
	ld8u r11, r0[r11]
	shl r11, r11, 8
	ldc r4, 10
	ld8u r4, r0[r4]
	ldc r5, 11
	ld8u r5, r0[r5]
	shl r5, r5, 24
	shl r4, r4, 16
	or r3, r11, r3
	or r3, r3, r4
	or r3, r3, r5
	ldc r11, 12
	ld8u r11, r0[r11]
	ldc r4, 13
	ld8u r4, r0[r4]
	shl r4, r4, 8
	ldc r5, 14
	ld8u r5, r0[r5]
	mkmsk r6, 4
	ld8u r6, r0[r6]
	shl r6, r6, 24
	shl r5, r5, 16
	or r11, r4, r11
	or r11, r11, r5
	or r11, r11, r6
	stw r11, r1[3]
	stw r3, r1[2]
	ldc r3, 16
	ld8u r3, r0[r3]
	ldc r11, 17
	ld8u r11, r0[r11]
	shl r11, r11, 8
	or r3, r11, r3
	ldaw r11, r1[4]
	st16 r3, r11[r2]
	ldc r3, 18
	ld8u r11, r0[r3]
	ldc r4, 19
	ld8u r4, r0[r4]
	shl r4, r4, 8
	or r11, r4, r11
	add r3, r1, r3
	st16 r11, r3[r2]
	ldc r3, 20
	ld8u r3, r0[r3]
	ldc r11, 21
	ld8u r11, r0[r11]
	shl r11, r11, 8
	or r3, r11, r3
	ldaw r11, r1[5]
	st16 r3, r11[r2]
	ldc r3, 22
	ld8u r11, r0[r3]
	ldc r4, 23
	ld8u r4, r0[r4]
	shl r4, r4, 8
	or r11, r4, r11
	add r3, r1, r3
	st16 r11, r3[r2]
	ldc r2, 26
	ld8u r2, r0[r2]
	mkmsk r3, 1
	st8 r2, r1[r3]
	ldc r2, 27
	ld8u r2, r0[r2]
	ldc r3, 2
	st8 r2, r1[r3]
	ldaw r0, r0[8]
	stw r0, r1[6]
	ldw r6, sp[0]
	ldw r5, sp[1]
	ldw r4, sp[2]
	ldaw sp, sp[3]
	retsp 0
	.cc_bottom fields_get.function
.Lfunc_end1:
	.size	fields_get, .Lfunc_end1-fields_get

	.p2align	2
	.type	items_valid,@function
	.cc_top items_valid.function,items_valid
items_valid:
	extsp 1
	stw r4, sp[0]
	mov r2, r0
	add r3, r2, 2
	ldc r0, 0
	ld16s r11, r3[r0]
	zext r11, 16
	ldc r3, 18
	add r3, r1, r3
	ld16s r3, r3[r0]
	zext r3, 16
	bf r11, .LBB2_1
	eq r4, r3, 0
	eq r4, r4, 0
	lsu r11, r11, r3
	eq r11, r11, 0
	and r11, r4, r11
	bu .LBB2_3
.LBB2_1:
	eq r11, r3, 0
	mkmsk r3, 1
.LBB2_3:
	ld16s r2, r2[r0]
	zext r2, 16
	bf r2, .LBB2_4
	bf r11, .LBB2_9
	ldaw r0, r1[4]
	ldc r1, 0
	ld16s r0, r0[r1]
	zext r0, 16
	add r0, r3, r0
	lsu r0, r2, r0
	bu .LBB2_8
.LBB2_4:
	bf r11, .LBB2_9
	ldaw r0, r1[4]
	ldc r1, 0
	ld16s r0, r0[r1]
	zext r0, 16
.LBB2_8:
	eq r0, r0, 0
.LBB2_9:
	ldw r4, sp[0]
	ldaw sp, sp[1]
	retsp 0
	.cc_bottom items_valid.function
.Lfunc_end2:
	.size	items_valid, .Lfunc_end2-items_valid

	.p2align	2
	.type	others_valid,@function
	.cc_top others_valid.function,others_valid
others_valid:
	mkmsk r2, 1
	ld8u r2, r1[r2]
	ldc r3, 6
	ld8u r3, r0[r3]
	mkmsk r11, 8
	xor r3, r3, r11
	and r3, r2, r3
	ldc r2, 0
	bf r3, .LBB3_1
.LBB3_9:
	mov r0, r2
	retsp 0
.LBB3_1:
	ldc r3, 8
	ld8u r3, r0[r3]
	bf r3, .LBB3_2
.LBB3_3:
	ldc r2, 9
	ld8u r2, r0[r2]
	ldaw r11, r1[5]
	ldc r3, 0
	ld16s r11, r11[r3]
	zext r11, 16
	eq r11, r11, 0
	eq r11, r11, 0
	eq r2, r2, r11
	bf r2, .LBB3_4
	ldc r2, 10
	ld8u r2, r0[r2]
	bt r2, .LBB3_7
	ldc r2, 22
	add r11, r1, r2
	ldc r2, 0
	ld16s r11, r11[r2]
	zext r11, 16
	bt r11, .LBB3_9
.LBB3_7:
	ldc r2, 2
	ld8u r1, r1[r2]
	mkmsk r2, 3
	ld8u r0, r0[r2]
	lsu r11, r0, r1
	mov r2, r3
	bt r11, .LBB3_9
	eq r0, r0, 0
	eq r1, r1, 0
	eq r1, r1, 0
	or r2, r0, r1
	mov r0, r2
	retsp 0
.LBB3_4:
	mov r2, r3
	mov r0, r2
	retsp 0
.LBB3_2:
	ldw r3, r1[3]
	ldw r11, r1[2]
	or r3, r11, r3
	bt r3, .LBB3_9
	bu .LBB3_3
	.cc_bottom others_valid.function
.Lfunc_end3:
	.size	others_valid, .Lfunc_end3-others_valid

	.section	.cp.rodata.cst4,"aMc",@progbits,4
	.p2align	2
.LCPI4_0:
	.long	4294967294
	.text
	.p2align	2
	.type	payload_valid,@function
	.cc_top payload_valid.function,payload_valid
payload_valid:
	extsp 2
	stw r4, sp[1]
	stw r5, sp[0]
	mov r2, r0
	ldc r0, 11
	ld8u r11, r2[r0]
	mkmsk r0, 1
	ldc r3, 0
	bt r11, .LBB4_5
	ldc r11, 18
	add r4, r1, r11
	ldc r11, 0
	ld16s r4, r4[r11]
	zext r4, 16
	add r2, r2, 4
	ld16s r2, r2[r11]
	zext r2, 16
	mul r2, r2, r4
	ldc r4, 480
	eq r5, r2, r4
	bt r5, .LBB4_5
	ldw r0, r1[6]
.LBB4_3:
	ld8u r5, r0[r2]
	or r11, r11, r5
	add r2, r2, 1
	eq r5, r2, r4
	bf r5, .LBB4_3
	eq r0, r11, 0
.LBB4_5:
	ld8u r2, r1[r3]
	eq r2, r2, 3
	bf r2, .LBB4_12
	ldc r2, 18
	add r2, r1, r2
	ld16s r2, r2[r3]
	zext r2, 16
	bf r2, .LBB4_12
	ldw r1, r1[6]
	add r1, r1, 3
	ldw r11, cp[.LCPI4_0]
	bu .LBB4_8
.LBB4_11:
	sub r2, r2, 1
	add r1, r1, 4
	bf r2, .LBB4_12
.LBB4_8:
	mov r4, r0
	zext r4, 1
	mov r0, r3
	bf r4, .LBB4_11
	ld8u r4, r1[r11]
	mov r0, r3
	bt r4, .LBB4_11
	sub r0, r1, 1
	ld8u r4, r1[r3]
	ld8u r0, r0[r3]
	or r0, r0, r4
	eq r0, r0, 0
	eq r0, r0, 0
	bu .LBB4_11
.LBB4_12:
	ldw r5, sp[0]
	ldw r4, sp[1]
	ldaw sp, sp[2]
	retsp 0
	.cc_bottom payload_valid.function
.Lfunc_end4:
	.size	payload_valid, .Lfunc_end4-payload_valid

	.globl	pw_kind_is_change
	.p2align	2
	.type	pw_kind_is_change,@function
	.cc_top pw_kind_is_change.function,pw_kind_is_change
pw_kind_is_change:
	sub r0, r0, 1
	mov r1, r0
	zext r1, 8
	mkmsk r2, 3
	lsu r1, r1, r2
	zext r0, 7
	ldc r2, 105
	shr r0, r2, r0
	and r0, r1, r0
	retsp 0
	.cc_bottom pw_kind_is_change.function
.Lfunc_end5:
	.size	pw_kind_is_change, .Lfunc_end5-pw_kind_is_change

	.globl	pw_kind_is_store
	.p2align	2
	.type	pw_kind_is_store,@function
	.cc_top pw_kind_is_store.function,pw_kind_is_store
pw_kind_is_store:
	ldc r1, 254
	and r1, r0, r1
	eq r1, r1, 2
	eq r0, r0, 5
	or r0, r0, r1
	retsp 0
	.cc_bottom pw_kind_is_store.function
.Lfunc_end6:
	.size	pw_kind_is_store, .Lfunc_end6-pw_kind_is_store

	.globl	pw_block_number
	.p2align	2
	.type	pw_block_number,@function
	.cc_top pw_block_number.function,pw_block_number
pw_block_number:
	extsp 1
	stw r4, sp[0]
	ldc r2, 5
	lsu r2, r1, r2
	bt r2, .LBB7_1
	sub r2, r1, 5
	mkmsk r1, 2
	lsu r3, r2, r1
	bt r3, .LBB7_4
	mov r2, r1
.LBB7_4:
	add r1, r0, 4
	shl r0, r2, 3
	add r2, r0, 8
	ldc r3, 0
	mov r11, r3
	mov r0, r3
.LBB7_5:
	ld8u r4, r1[r3]
	shl r4, r4, r11
	or r0, r4, r0
	add r1, r1, 1
	add r11, r11, 8
	eq r4, r2, r11
	bf r4, .LBB7_5
	bu .LBB7_6
.LBB7_1:
	ldc r0, 0
.LBB7_6:
	ldw r4, sp[0]
	ldaw sp, sp[1]
	retsp 0
	.cc_bottom pw_block_number.function
.Lfunc_end7:
	.size	pw_block_number, .Lfunc_end7-pw_block_number

	.globl	pw_block_features
	.p2align	2
	.type	pw_block_features,@function
	.cc_top pw_block_features.function,pw_block_features
pw_block_features:
	mov r1, r0
	ldc r0, 0
	ld8u r2, r1[r0]
	sub r3, r2, 2
	ldc r2, 5
	lsu r11, r2, r3
	bt r11, .LBB8_8
	bru r3
	.jmptable .LBB8_2,.LBB8_2,.LBB8_3,.LBB8_6,.LBB8_6,.LBB8_7
.LBB8_2:
	mkmsk r0, 1
	retsp 0
.LBB8_6:
	ldc r0, 2
	retsp 0
.LBB8_3:
	mkmsk r0, 1
	ld8u r1, r1[r0]
	ldc r3, 2
	and r1, r1, r3
	bt r1, .LBB8_5
	mov r2, r0
.LBB8_5:
	mov r0, r2
	retsp 0
.LBB8_7:
	ldc r0, 2
	ld8u r0, r1[r0]
	eq r0, r0, 1
	shl r0, r0, 1
.LBB8_8:
	retsp 0
	.cc_bottom pw_block_features.function
.Lfunc_end8:
	.size	pw_block_features, .Lfunc_end8-pw_block_features

	.globl	pw_entry_get
	.p2align	2
	.type	pw_entry_get,@function
	.cc_top pw_entry_get.function,pw_entry_get
pw_entry_get:
	shl r3, r2, 2
	ldaw r2, r1[r2]
	ld8u r1, r1[r3]
	mkmsk r3, 1
	ld8u r3, r2[r3]
	shl r3, r3, 8
	or r1, r3, r1
	ldc r3, 0
	st16 r1, r0[r3]
	add r0, r0, 2
	ldc r1, 2
	ld8u r1, r2[r1]
	mkmsk r11, 2
	ld8u r2, r2[r11]
	shl r2, r2, 8
	or r1, r2, r1
	st16 r1, r0[r3]
	retsp 0
	.cc_bottom pw_entry_get.function
.Lfunc_end9:
	.size	pw_entry_get, .Lfunc_end9-pw_entry_get

	.section	.cp.rodata,"ac",@progbits
	.cc_top rules.data,rules
	.p2align	2
	.type	rules,@object
	.size	rules, 120
rules:
	.space	12
	.short	0
	.short	0
	.short	0
	.byte	1
	.byte	0
	.byte	1
	.byte	0
	.byte	0
	.byte	1
	.short	256
	.short	0
	.short	0
	.byte	1
	.byte	0
	.byte	0
	.byte	0
	.byte	0
	.byte	1
	.short	1024
	.short	120
	.short	4
	.byte	1
	.byte	0
	.byte	0
	.byte	0
	.byte	0
	.byte	0
	.short	1024
	.short	1024
	.short	0
	.byte	3
	.byte	0
	.byte	1
	.byte	0
	.byte	1
	.byte	0
	.short	4096
	.short	480
	.short	1
	.byte	1
	.byte	0
	.byte	0
	.byte	0
	.byte	0
	.byte	0
	.short	4096
	.short	4096
	.short	0
	.byte	1
	.byte	0
	.byte	1
	.byte	1
	.byte	0
	.byte	0
	.short	0
	.short	0
	.short	0
	.byte	1
	.byte	3
	.byte	1
	.byte	0
	.byte	0
	.byte	0
	.short	0
	.short	0
	.short	0
	.byte	1
	.byte	0
	.byte	0
	.byte	0
	.byte	0
	.byte	0
	.short	0
	.short	0
	.short	0
	.byte	1
	.byte	0
	.byte	0
	.byte	0
	.byte	0
	.byte	0
	.cc_bottom rules.data
	.ident	"Debian clang version 14.0.6"
	.section	".note.GNU-stack","",@progbits
