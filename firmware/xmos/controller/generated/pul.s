# Made by clang from pul.c; do not edit.
# sha256 of it and what it includes: b3b4627e54fa901354b850e5fc18f83d5fa3cc470a6682853727e33968e16f56
	.text
	.globl	pw_pulse_get
	.p2align	2
	.type	pw_pulse_get,@function
	.cc_top pw_pulse_get.function,pw_pulse_get
pw_pulse_get:
	extsp 2
	stw r4, sp[1]
	stw r5, sp[0]
	shr r3, r2, 1
	lda16 r4, r3[r3]
	add r5, r1, r4
	mkmsk r3, 1
	ld8u r11, r5[r3]
	shl r11, r11, 8
	zext r2, 1
	bt r2, .LBB0_1
	ld8u r1, r1[r4]
	ldc r2, 3840
	and r2, r11, r2
	or r1, r2, r1
	bu .LBB0_3
.LBB0_1:
	ldc r1, 2
	ld8u r1, r5[r1]
	shl r1, r1, 16
	or r1, r1, r11
	ldc r2, 12
	shr r1, r1, r2
.LBB0_3:
	shr r2, r1, 7
	zext r1, 7
	ldc r11, 0
	st8 r1, r0[r11]
	st8 r2, r0[r3]
	ldw r5, sp[0]
	ldw r4, sp[1]
	ldaw sp, sp[2]
	retsp 0
	.cc_bottom pw_pulse_get.function
.Lfunc_end0:
	.size	pw_pulse_get, .Lfunc_end0-pw_pulse_get

	.globl	pw_pulse_put
	.p2align	2
	.type	pw_pulse_put,@function
	.cc_top pw_pulse_put.function,pw_pulse_put
pw_pulse_put:
	entsp 4
	stw r4, sp[3]
	stw r5, sp[2]
	stw r6, sp[1]
	ldc r3, 0
	ld16s r2, r2[r3]
	ldaw r4, sp[0]
	st16 r2, r4[r3]
	shr r2, r1, 1
	lda16 r2, r2[r2]
	add r0, r0, r2
	ld8u r11, r4[r3]
	mov r5, r11
	zext r5, 7
	mkmsk r2, 1
	or r4, r4, r2
	ld8u r4, r4[r3]
	zext r4, 5
	shl r6, r4, 7
	or r5, r6, r5
	zext r1, 1
	bt r1, .LBB1_2
	st8 r5, r0[r3]
	ld8u r1, r0[r2]
	ldc r3, 240
	and r1, r1, r3
	shr r3, r4, 1
	or r1, r1, r3
	bu .LBB1_3
.LBB1_2:
	ld8u r1, r0[r2]
	zext r1, 4
	shl r3, r11, 4
	or r1, r1, r3
	st8 r1, r0[r2]
	shr r1, r5, 4
	ldc r2, 2
.LBB1_3:
	st8 r1, r0[r2]
	ldw r6, sp[1]
	ldw r5, sp[2]
	ldw r4, sp[3]
	retsp 4
	.cc_bottom pw_pulse_put.function
.Lfunc_end1:
	.size	pw_pulse_put, .Lfunc_end1-pw_pulse_put

	.section	.cp.rodata.cst4,"aMc",@progbits,4
	.p2align	2
.LCPI2_0:
	.long	520319
.LCPI2_1:
	.long	127007
.LCPI2_2:
	.long	114716
.LCPI2_3:
	.long	524416
.LCPI2_4:
	.long	131104
	.text
	.globl	pw_pulses_valid
	.p2align	2
	.type	pw_pulses_valid,@function
	.cc_top pw_pulses_valid.function,pw_pulses_valid
pw_pulses_valid:
	extsp 7
	stw r4, sp[6]
	stw r5, sp[5]
	stw r6, sp[4]
	stw r7, sp[3]
	stw r8, sp[2]
	stw r9, sp[1]
	stw r10, sp[0]
	ldc r4, 2
	lsu r3, r1, r4
	bf r3, .LBB2_4
	mkmsk r0, 1
	bu .LBB2_3
.LBB2_4:
	shr r1, r1, 1
	ldc r3, 0
	ldw r5, cp[.LCPI2_1]
	ldw r6, cp[.LCPI2_2]
	ldw r7, cp[.LCPI2_3]
	ldc r8, 24582
	ldw r9, cp[.LCPI2_4]
	mov r10, r3
.LBB2_5:
	ld8u r2, r0[r3]
	mkmsk r11, 1
	ld8u r11, r0[r11]
	shl r11, r11, 8
	or r2, r11, r2
	ld8u r11, r0[r4]
	shl r11, r11, 16
	or r2, r2, r11
	ldw r11, cp[.LCPI2_0]
	and r11, r2, r11
	shr r2, r2, 7
	and r2, r2, r5
	add r11, r11, r6
	and r11, r11, r7
	or r11, r11, r10
	add r2, r2, r8
	and r2, r2, r9
	or r10, r11, r2
	sub r1, r1, 1
	add r0, r0, 3
	bt r1, .LBB2_5
	eq r0, r10, 0
.LBB2_3:
	ldw r10, sp[0]
	ldw r9, sp[1]
	ldw r8, sp[2]
	ldw r7, sp[3]
	ldw r6, sp[4]
	ldw r5, sp[5]
	ldw r4, sp[6]
	ldaw sp, sp[7]
	retsp 0
	.cc_bottom pw_pulses_valid.function
.Lfunc_end2:
	.size	pw_pulses_valid, .Lfunc_end2-pw_pulses_valid

	.globl	pw_pulses_power
	.p2align	2
	.type	pw_pulses_power,@function
	.cc_top pw_pulses_power.function,pw_pulses_power
pw_pulses_power:
	extsp 5
	stw r4, sp[4]
	stw r5, sp[3]
	stw r6, sp[2]
	stw r7, sp[1]
	stw r8, sp[0]
	ldc r2, 2
	lsu r3, r1, r2
	bf r3, .LBB3_3
	ldc r1, 0
	bu .LBB3_2
.LBB3_3:
	shr r3, r1, 1
	ldc r4, 0
	mkmsk r5, 1
	ldc r6, 62
	mov r1, r4
.LBB3_4:
	ld8u r11, r0[r4]
	ld8u r7, r0[r5]
	shl r7, r7, 8
	or r11, r7, r11
	ld8u r7, r0[r2]
	shr r11, r11, 6
	and r8, r11, r6
	ldaw r11, cp[powers]
	add r8, r8, r11
	ld16s r8, r8[r4]
	zext r8, 16
	add r1, r1, r8
	shr r7, r7, 2
	and r7, r7, r6
	add r11, r7, r11
	ld16s r11, r11[r4]
	zext r11, 16
	add r1, r1, r11
	sub r3, r3, 1
	add r0, r0, 3
	bt r3, .LBB3_4
.LBB3_2:
	mov r0, r1
	ldw r8, sp[0]
	ldw r7, sp[1]
	ldw r6, sp[2]
	ldw r5, sp[3]
	ldw r4, sp[4]
	ldaw sp, sp[5]
	retsp 0
	.cc_bottom pw_pulses_power.function
.Lfunc_end3:
	.size	pw_pulses_power, .Lfunc_end3-pw_pulses_power

	.globl	pw_pulses_sort
	.p2align	2
	.type	pw_pulses_sort,@function
	.cc_top pw_pulses_sort.function,pw_pulses_sort
pw_pulses_sort:
	entsp 171
	stw r4, sp[170]
	stw r5, sp[169]
	stw r6, sp[168]
	stw r7, sp[167]
	stw r8, sp[166]
	stw r9, sp[165]
	stw r10, sp[164]
	mov r4, r2
	mov r6, r1
	stw r0, sp[2]
	ldaw r5, sp[4]
	ldc r8, 0
	ldc r2, 640
	mov r0, r5
	mov r1, r8
	bl memset
	mkmsk r0, 1
	ldc r1, 2
	ldc r9, 319
	ldc r2, 12
	mov r10, r8
	bu .LBB4_1
.LBB4_5:
	add r10, r10, 3
	add r6, r6, 4
	ldc r3, 480
	eq r3, r10, r3
	ldc r8, 0
	mov r9, r7
	bt r3, .LBB4_6
.LBB4_1:
	ldw r3, sp[2]
	add r3, r3, r10
	stw r3, sp[1]
	ld8u r11, r3[r0]
	shl r3, r11, 8
	stw r3, sp[3]
	mov r11, r8
	ld16s r8, r6[r11]
	zext r8, 16
	lsu r3, r9, r8
	bt r3, .LBB4_3
	ldw r3, sp[2]
	ld8u r3, r3[r10]
	ldw r7, sp[3]
	or r3, r7, r3
	ldc r7, 4095
	and r3, r3, r7
	ldaw r7, sp[4]
	st16 r3, r7[r8]
.LBB4_3:
	add r3, r6, 2
	ld16s r8, r3[r11]
	zext r8, 16
	mov r7, r9
	lsu r3, r9, r8
	bt r3, .LBB4_5
	ldw r3, sp[1]
	ld8u r3, r3[r1]
	shl r3, r3, 16
	ldw r11, sp[3]
	or r3, r3, r11
	shr r3, r3, r2
	ldaw r11, sp[4]
	st16 r3, r11[r8]
	bu .LBB4_5
.LBB4_6:
	ldc r3, 0
	ldc r11, 48
	mov r7, r3
.LBB4_7:
	stw r7, sp[2]
	stw r5, sp[3]
	mov r8, r5
	mov r9, r3
.LBB4_8:
	ld16s r10, r8[r3]
	add r6, r8, 2
	ld16s r6, r6[r3]
	shl r5, r6, r2
	or r5, r5, r10
	add r7, r4, r9
	st8 r10, r4[r9]
	shr r5, r5, 8
	st8 r5, r7[r0]
	shr r5, r6, 4
	st8 r5, r7[r1]
	add r9, r9, 3
	add r8, r8, 4
	eq r5, r9, r11
	bf r5, .LBB4_8
	ldw r7, sp[2]
	add r7, r7, 1
	add r4, r4, r11
	ldw r5, sp[3]
	ldc r6, 64
	add r5, r5, r6
	eq r8, r7, 10
	bf r8, .LBB4_7
	ldw r10, sp[164]
	ldw r9, sp[165]
	ldw r8, sp[166]
	ldw r7, sp[167]
	ldw r6, sp[168]
	ldw r5, sp[169]
	ldw r4, sp[170]
	retsp 171
	.cc_bottom pw_pulses_sort.function
.Lfunc_end4:
	.size	pw_pulses_sort, .Lfunc_end4-pw_pulses_sort

	.globl	pw_pulses_unsort
	.p2align	2
	.type	pw_pulses_unsort,@function
	.cc_top pw_pulses_unsort.function,pw_pulses_unsort
pw_pulses_unsort:
	extsp 7
	stw r4, sp[6]
	stw r5, sp[5]
	stw r6, sp[4]
	stw r7, sp[3]
	stw r8, sp[2]
	stw r9, sp[1]
	stw r10, sp[0]
	ldc r10, 0
	mkmsk r4, 1
	ldc r5, 2
	ldc r9, 320
	bu .LBB5_1
.LBB5_7:
	ld8u r11, r7[r4]
	zext r11, 4
	shl r8, r6, 4
	or r11, r11, r8
	st8 r11, r7[r4]
	shr r11, r6, 4
	st8 r11, r7[r5]
.LBB5_8:
	add r10, r10, 1
	eq r11, r10, r9
	bt r11, .LBB5_9
.LBB5_1:
	ld16s r6, r2[r10]
	zext r6, 16
	shr r11, r6, 5
	eq r11, r11, r1
	bf r11, .LBB5_8
	shr r11, r6, 1
	zext r11, 4
	lda16 r8, r11[r11]
	add r11, r0, r8
	ld8u r7, r11[r4]
	shl r7, r7, 8
	zext r6, 1
	bt r6, .LBB5_3
	ld8u r11, r0[r8]
	ldc r6, 3840
	and r6, r7, r6
	or r6, r6, r11
	bu .LBB5_5
.LBB5_3:
	ld8u r11, r11[r5]
	shl r11, r11, 16
	or r11, r11, r7
	ldc r6, 12
	shr r6, r11, r6
.LBB5_5:
	shr r11, r10, 1
	lda16 r11, r11[r11]
	add r7, r3, r11
	mov r11, r10
	zext r11, 1
	bt r11, .LBB5_7
	shr r11, r6, 7
	ldc r8, 0
	st8 r6, r7[r8]
	ld8u r6, r7[r4]
	ldc r8, 240
	and r6, r6, r8
	shr r11, r11, 1
	or r11, r6, r11
	st8 r11, r7[r4]
	bu .LBB5_8
.LBB5_9:
	ldw r10, sp[0]
	ldw r9, sp[1]
	ldw r8, sp[2]
	ldw r7, sp[3]
	ldw r6, sp[4]
	ldw r5, sp[5]
	ldw r4, sp[6]
	ldaw sp, sp[7]
	retsp 0
	.cc_bottom pw_pulses_unsort.function
.Lfunc_end5:
	.size	pw_pulses_unsort, .Lfunc_end5-pw_pulses_unsort

	.section	.cp.rodata.cst4,"aMc",@progbits,4
	.p2align	2
.LCPI6_0:
	.long	1374389535
	.text
	.globl	pw_pulse_begin
	.p2align	2
	.type	pw_pulse_begin,@function
	.cc_top pw_pulse_begin.function,pw_pulse_begin
pw_pulse_begin:
	entsp 1
	ldc r1, 0
	ld16s r0, r0[r1]
	ldaw r2, sp[0]
	st16 r0, r2[r1]
	ld8u r0, r2[r1]
	mkmsk r3, 1
	or r2, r2, r3
	ld8u r2, r2[r1]
	sub r0, r0, r2
	ldc r2, 100
	add r0, r0, r2
	shr r0, r0, 1
	ldw r2, cp[.LCPI6_0]
	lmul r1, r2, r0, r2, r1, r1
	shr r1, r1, 4
	ldc r2, 50
	mul r1, r1, r2
	sub r0, r0, r1
	retsp 1
	.cc_bottom pw_pulse_begin.function
.Lfunc_end6:
	.size	pw_pulse_begin, .Lfunc_end6-pw_pulse_begin

	.globl	pw_modulated_width
	.p2align	2
	.type	pw_modulated_width,@function
	.cc_top pw_modulated_width.function,pw_modulated_width
pw_modulated_width:
	extsp 1
	stw r4, sp[0]
	ldc r2, 25
	lsu r2, r2, r0
	bt r2, .LBB7_1
	ldc r2, 0
.LBB7_3:
	eq r3, r0, r2
	bt r3, .LBB7_6
	add r3, r2, 1
	ldaw r11, cp[amplitudes]
	ldw r11, r11[r0]
	mul r4, r11, r1
	ldaw r11, cp[bounds+4]
	ldw r2, r11[r2]
	lsu r11, r4, r2
	mov r2, r3
	bf r11, .LBB7_3
	sub r0, r3, 1
	bu .LBB7_6
.LBB7_1:
	ldc r0, 0
.LBB7_6:
	zext r0, 8
	ldw r4, sp[0]
	ldaw sp, sp[1]
	retsp 0
	.cc_bottom pw_modulated_width.function
.Lfunc_end7:
	.size	pw_modulated_width, .Lfunc_end7-pw_modulated_width

	.section	.cp.rodata.cst4,"aMc",@progbits,4
	.p2align	2
.LCPI8_0:
	.long	1374389535
.LCPI8_1:
	.long	4294967246
	.text
	.globl	pw_rasterise
	.p2align	2
	.type	pw_rasterise,@function
	.cc_top pw_rasterise.function,pw_rasterise
pw_rasterise:
	entsp 16
	stw r4, sp[15]
	stw r5, sp[14]
	stw r6, sp[13]
	stw r7, sp[12]
	stw r8, sp[11]
	stw r9, sp[10]
	stw r10, sp[9]
	mov r4, r2
	mov r8, r1
	mov r5, r0
	ldaw r6, sp[1]
	ldc r9, 0
	ldc r2, 32
	mov r0, r6
	mov r1, r9
	bl memset
	ldc r0, 26
	mov r1, r9
	bu .LBB8_1
.LBB8_4:
	mov r1, r2
.LBB8_7:
	st8 r1, r6[r9]
	add r9, r9, 1
	eq r2, r9, r0
	bt r2, .LBB8_8
.LBB8_1:
	lsu r3, r9, r1
	mov r2, r1
	bt r3, .LBB8_3
	mov r2, r9
.LBB8_3:
	eq r3, r2, r1
	bt r3, .LBB8_4
	add r3, r1, 1
	ldaw r11, cp[amplitudes]
	ldw r11, r11[r9]
	mul r7, r11, r8
	ldaw r11, cp[bounds+4]
	ldw r1, r11[r1]
	lsu r11, r7, r1
	mov r1, r3
	bf r11, .LBB8_3
	sub r1, r3, 1
	bu .LBB8_7
.LBB8_8:
	ldc r8, 0
	ldc r2, 200
	mov r0, r4
	mov r1, r8
	bl memset
	mkmsk r2, 1
	ldc r0, 50
	mov r1, r8
	bu .LBB8_9
.LBB8_16:
	xor r1, r9, r1
	ldw r11, r4[r3]
	xor r11, r11, r7
	stw r11, r4[r3]
	ldw r3, r4[r10]
	xor r3, r3, r7
	stw r3, r4[r10]
	add r8, r8, 1
	ldc r3, 32
	eq r3, r8, r3
	bt r3, .LBB8_17
.LBB8_9:
	shr r3, r8, 1
	lda16 r7, r3[r3]
	add r9, r5, r7
	ld8u r3, r9[r2]
	shl r3, r3, 8
	mov r11, r8
	zext r11, 1
	bt r11, .LBB8_10
	ld8u r11, r5[r7]
	ldc r7, 3840
	and r3, r3, r7
	or r3, r3, r11
	bu .LBB8_12
.LBB8_10:
	ldc r11, 2
	ld8u r11, r9[r11]
	shl r11, r11, 16
	or r3, r11, r3
	ldc r11, 12
	shr r3, r3, r11
.LBB8_12:
	shr r11, r3, 7
	zext r3, 7
	ld8u r11, r6[r11]
	shl r7, r2, r8
	sub r3, r3, r11
	ldc r9, 100
	add r3, r3, r9
	shr r3, r3, 1
	ldc r9, 0
	ldw r10, cp[.LCPI8_0]
	lmul r9, r10, r3, r10, r9, r9
	shr r9, r9, 4
	mul r9, r9, r0
	sub r3, r3, r9
	add r10, r3, r11
	ldc r11, 49
	lsu r11, r11, r10
	mov r9, r7
	bt r11, .LBB8_14
	ldc r9, 0
.LBB8_14:
	bf r11, .LBB8_16
	ldw r11, cp[.LCPI8_1]
	add r10, r10, r11
	bu .LBB8_16
.LBB8_17:
	ldc r2, 0
.LBB8_18:
	ldw r3, r4[r2]
	xor r1, r3, r1
	stw r1, r4[r2]
	add r2, r2, 1
	eq r3, r2, r0
	bf r3, .LBB8_18
	ldw r10, sp[9]
	ldw r9, sp[10]
	ldw r8, sp[11]
	ldw r7, sp[12]
	ldw r6, sp[13]
	ldw r5, sp[14]
	ldw r4, sp[15]
	retsp 16
	.cc_bottom pw_rasterise.function
.Lfunc_end8:
	.size	pw_rasterise, .Lfunc_end8-pw_rasterise

	.section	.cp.rodata,"ac",@progbits
	.cc_top powers.data,powers
	.p2align	2
	.type	powers,@object
	.size	powers, 64
powers:
	.short	0
	.short	4
	.short	16
	.short	35
	.short	62
	.short	95
	.short	136
	.short	181
	.short	232
	.short	287
	.short	345
	.short	406
	.short	469
	.short	531
	.short	594
	.short	655
	.short	713
	.short	768
	.short	819
	.short	864
	.short	905
	.short	938
	.short	965
	.short	984
	.short	996
	.short	1000
	.short	1000
	.short	1000
	.short	1000
	.short	1000
	.short	1000
	.short	1000
	.cc_bottom powers.data
	.cc_top amplitudes.data,amplitudes
	.p2align	2
	.type	amplitudes,@object
	.size	amplitudes, 104
amplitudes:
	.long	0
	.long	1053450
	.long	2102743
	.long	3143737
	.long	4172324
	.long	5184445
	.long	6176105
	.long	7143391
	.long	8082485
	.long	8989682
	.long	9861400
	.long	10694200
	.long	11484795
	.long	12230064
	.long	12927067
	.long	13573053
	.long	14165472
	.long	14701986
	.long	15180479
	.long	15599061
	.long	15956081
	.long	16250129
	.long	16480045
	.long	16644923
	.long	16744110
	.long	16777216
	.cc_bottom amplitudes.data
	.cc_top bounds.data,bounds
	.p2align	2
	.type	bounds,@object
	.size	bounds, 104
bounds:
	.long	0
	.long	134381198
	.long	402613252
	.long	669256377
	.long	933258251
	.long	1193576982
	.long	1449185210
	.long	1699074166
	.long	1942257652
	.long	2177775935
	.long	2404699531
	.long	2622132877
	.long	2829217862
	.long	3025137217
	.long	3209117737
	.long	3380433336
	.long	3538407908
	.long	3682418001
	.long	3811895273
	.long	3926328735
	.long	4025266772
	.long	4108318920
	.long	4175157410
	.long	4225518461
	.long	4259203321
	.long	4276079051
	.cc_bottom bounds.data
	.ident	"Debian clang version 14.0.6"
	.section	".note.GNU-stack","",@progbits
