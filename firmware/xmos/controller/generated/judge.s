# Made by clang from judge.c; do not edit.
# sha256 of it and what it includes: cdecfbe314574d832a23ae9982c1fb42890764b979549e22576b6cf792c40a20
	.text
	.section	.cp.rodata.cst4,"aMc",@progbits,4
	.p2align	2
.LCPI0_0:
	.long	16711680
.LCPI0_1:
	.long	65536
.LCPI0_2:
	.long	4127195136
.LCPI0_3:
	.long	4143972352
.LCPI0_4:
	.long	50331648
.LCPI0_5:
	.long	4294967292
.LCPI0_6:
	.long	4294967293
.LCPI0_7:
	.long	262144
	.text
	.globl	judge
	.p2align	2
	.type	judge,@function
	.cc_top judge.function,judge
judge:
	entsp 11
	stw r4, sp[10]
	stw r5, sp[9]
	stw r6, sp[8]
	stw r7, sp[7]
	stw r8, sp[6]
	stw r9, sp[5]
	stw r10, sp[4]
	ldw r2, r0[7]
	eq r1, r2, r1
	bf r1, .LBB0_5
	ldw r2, r0[0]
	mov r1, r2
	zext r1, 16
	ldc r3, 22352
	eq r1, r1, r3
	bf r1, .LBB0_6
	ldw r1, cp[.LCPI0_0]
	and r3, r2, r1
	ldw r1, cp[.LCPI0_1]
	eq r3, r3, r1
	bf r3, .LBB0_7
	ldw r3, cp[.LCPI0_2]
	add r3, r2, r3
	ldw r11, cp[.LCPI0_3]
	lsu r3, r3, r11
	bf r3, .LBB0_9
	ldc r0, 5
	bu .LBB0_8
.LBB0_5:
	ldc r0, 2
	bu .LBB0_8
.LBB0_6:
	mkmsk r0, 2
	bu .LBB0_8
.LBB0_7:
	ldc r0, 4
	bu .LBB0_8
.LBB0_9:
	shr r3, r2, 24
	ldw r11, r0[2]
	ldw r4, r0[3]
	or r4, r4, r11
	ldc r11, 24
	mul r6, r3, r11
	ldaw r11, cp[rules]
	add r11, r6, r11
	ldw r11, r11[0]
	and r5, r4, r11
	ldw r4, r0[4]
	ldaw r11, cp[rules+4]
	add r11, r6, r11
	ldw r11, r11[0]
	and r9, r11, r4
	ldw r7, r0[5]
	ldaw r11, cp[rules+8]
	add r11, r6, r11
	ldw r11, r11[0]
	and r10, r11, r7
	ldw r8, r0[6]
	ldaw r11, cp[rules+12]
	add r11, r6, r11
	ldw r11, r11[0]
	and r11, r11, r8
	or r5, r9, r5
	or r5, r5, r10
	or r11, r5, r11
	ldw r5, cp[.LCPI0_4]
	lsu r2, r2, r5
	bt r2, .LBB0_37
	bt r11, .LBB0_37
	ldc r5, 0
	shr r10, r4, 16
	sub r11, r3, 7
	ldw r9, cp[.LCPI0_5]
	lsu r11, r11, r9
	bf r11, .LBB0_15
	eq r11, r3, 7
	bf r11, .LBB0_20
	shr r11, r8, 24
	sub r11, r11, 4
	ldw r7, cp[.LCPI0_6]
	lsu r11, r11, r7
	bt r11, .LBB0_17
	bu .LBB0_20
.LBB0_15:
	ldaw r11, cp[rules+16]
	add r11, r6, r11
	add r8, r11, 2
	ld16s r8, r8[r5]
	zext r8, 16
	mov r9, r4
	zext r9, 16
	add r9, r9, r10
	ldw r1, cp[.LCPI0_1]
	mov r2, r10
	lsu r10, r4, r1
	mov r1, r2
	lsu r8, r8, r2
	or r8, r10, r8
	ld16s r11, r11[r5]
	zext r11, 16
	lsu r11, r11, r9
	or r11, r8, r11
	eq r8, r3, 6
	bf r8, .LBB0_18
	eq r7, r7, 0
	or r11, r7, r11
	mov r10, r1
	bf r11, .LBB0_20
	bu .LBB0_17
.LBB0_18:
	mov r10, r1
	bt r11, .LBB0_17
.LBB0_20:
	ldaw r0, r0[8]
	ldaw r11, cp[rules+20]
	ld8u r11, r6[r11]
	mul r11, r10, r11
	shr r7, r11, 2
	zext r11, 2
	bf r11, .LBB0_22
	ldw r6, r0[r7]
	shl r11, r11, 3
	shr r2, r6, r11
	add r7, r7, 1
	bu .LBB0_23
.LBB0_22:
	mov r2, r5
.LBB0_23:
	ldaw r6, r0[r7]
	ldc r8, 120
	sub r7, r8, r7
	ldc r8, 8
	lsu r8, r7, r8
	bt r8, .LBB0_27
	stw r2, sp[0]
	stw r4, sp[1]
	stw r3, sp[2]
	stw r10, sp[3]
	ldc r5, 0
.LBB0_25:
	ldw r9, r6[0]
	ldw r10, r6[1]
	ldw r11, r6[2]
	ldw r4, r6[3]
	ldw r3, r6[4]
	ldw r1, r6[5]
	ldw r8, r6[6]
	ldw r2, r6[7]
	or r5, r9, r5
	or r5, r5, r10
	or r11, r5, r11
	or r11, r11, r4
	or r3, r11, r3
	or r1, r3, r1
	or r1, r1, r8
	or r5, r1, r2
	ldaw r6, r6[8]
	sub r7, r7, 8
	mkmsk r1, 3
	lsu r1, r1, r7
	bt r1, .LBB0_25
	ldw r10, sp[3]
	ldw r3, sp[2]
	ldw r4, sp[1]
	ldw r2, sp[0]
.LBB0_27:
	ldw r8, cp[.LCPI0_1]
	bf r7, .LBB0_29
.LBB0_28:
	ldw r1, r6[0]
	or r5, r1, r5
	add r6, r6, 4
	sub r7, r7, 1
	bt r7, .LBB0_28
.LBB0_29:
	or r11, r5, r2
	eq r1, r3, 3
	bf r1, .LBB0_37
	ldw r1, cp[.LCPI0_7]
	lsu r1, r4, r1
	bt r1, .LBB0_33
	ldc r4, 0
	mkmsk r5, 2
	mov r3, r4
.LBB0_32:
	ldw r1, r0[0]
	ldw r2, r0[1]
	ldw r6, r0[2]
	ldw r7, r0[3]
	or r3, r1, r3
	or r3, r3, r2
	or r3, r3, r6
	or r3, r3, r7
	lsu r1, r1, r8
	lsu r2, r2, r8
	or r1, r1, r2
	or r1, r4, r1
	lsu r2, r6, r8
	lsu r4, r7, r8
	or r2, r2, r4
	or r4, r1, r2
	ldaw r0, r0[4]
	sub r10, r10, 4
	lsu r1, r5, r10
	bt r1, .LBB0_32
	bu .LBB0_34
.LBB0_33:
	ldc r3, 0
	mov r4, r3
.LBB0_34:
	bf r10, .LBB0_36
.LBB0_35:
	ldw r1, r0[0]
	or r3, r1, r3
	lsu r1, r1, r8
	or r4, r4, r1
	add r0, r0, 4
	sub r10, r10, 1
	bt r10, .LBB0_35
.LBB0_36:
	ldc r0, 65280
	and r0, r3, r0
	or r0, r0, r11
	or r11, r0, r4
.LBB0_37:
	bt r11, .LBB0_17
	ldc r0, 0
	bu .LBB0_8
.LBB0_17:
	ldc r0, 6
.LBB0_8:
	ldw r10, sp[4]
	ldw r9, sp[5]
	ldw r8, sp[6]
	ldw r7, sp[7]
	ldw r6, sp[8]
	ldw r5, sp[9]
	ldw r4, sp[10]
	retsp 11
	.cc_bottom judge.function
.Lfunc_end0:
	.size	judge, .Lfunc_end0-judge

	.section	.cp.rodata,"ac",@progbits
	.cc_top rules.data,rules
	.p2align	2
	.type	rules,@object
	.size	rules, 240
rules:
	.space	24
	.long	0
	.long	4294967295
	.long	4294967295
	.long	4294901759
	.short	0
	.short	0
	.byte	0
	.space	3
	.long	4294967295
	.long	4294967040
	.long	4294967295
	.long	4294901759
	.short	0
	.short	0
	.byte	0
	.space	3
	.long	4294967295
	.long	0
	.long	4294967295
	.long	4294901759
	.short	1024
	.short	120
	.byte	4
	.space	3
	.long	0
	.long	0
	.long	65535
	.long	4294770687
	.short	1024
	.short	1024
	.byte	0
	.space	3
	.long	4294967295
	.long	0
	.long	4294967295
	.long	4294901759
	.short	4096
	.short	480
	.byte	1
	.space	3
	.long	0
	.long	0
	.long	4294901760
	.long	4294901759
	.short	4096
	.short	4096
	.byte	0
	.space	3
	.long	0
	.long	4294967295
	.long	4294967295
	.long	16711679
	.short	0
	.short	0
	.byte	0
	.space	3
	.long	4294967295
	.long	4294967295
	.long	4294967295
	.long	4294901759
	.short	0
	.short	0
	.byte	0
	.space	3
	.long	4294967295
	.long	4294967295
	.long	4294967295
	.long	4294901759
	.short	0
	.short	0
	.byte	0
	.space	3
	.cc_bottom rules.data
	.ident	"Debian clang version 14.0.6"
	.section	".note.GNU-stack","",@progbits
