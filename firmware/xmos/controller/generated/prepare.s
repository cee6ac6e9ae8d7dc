# Made by clang from prepare.c; do not edit.
# sha256 of it and what it includes: 655f8ac38e2e7587a45872ead2a6eb70a18afb2d92418e80fbd2770088c023d9
	.text
	.globl	prepare
	.p2align	2
	.type	prepare,@function
	.cc_top prepare.function,prepare
prepare:
	entsp 10
	stw r4, sp[9]
	stw r5, sp[8]
	stw r6, sp[7]
	stw r7, sp[6]
	stw r8, sp[5]
	stw r9, sp[4]
	stw r10, sp[3]
	ldaw r1, sp[2]
	ldc r0, 0
	st16 r0, r1[r0]
	ldc r2, 2
	or r1, r1, r2
	st8 r0, r1[r0]
	ldaw r1, dp[codes]
	ldaw r2, dp[places]
	ldc r3, 320
.LBB0_1:
	ldaw r11, cp[wiring]
	ld16s r11, r11[r0]
	zext r11, 16
	ldaw r11, r1[r11]
	stw r11, r2[r0]
	add r0, r0, 1
	eq r11, r0, r3
	bf r11, .LBB0_1
	ldc r10, 0
	ldaw r5, sp[1]
	mkmsk r0, 1
	or r8, r5, r0
	ldaw r6, sp[2]
	ldc r7, 2
	ldc r9, 4096
	mov r4, r10
	bu .LBB0_3
.LBB0_5:
	ldaw r1, dp[powers]
	st16 r0, r1[r4]
	add r4, r4, 1
	eq r0, r4, r9
	bt r0, .LBB0_6
.LBB0_3:
	mov r0, r4
	zext r0, 7
	st8 r0, r5[r10]
	shr r0, r4, 7
	st8 r0, r8[r10]
	mov r0, r6
	mov r1, r10
	mov r2, r5
	bl pw_pulse_put
	mov r0, r6
	mov r1, r7
	bl pw_pulses_valid
	mov r1, r0
	ldc r0, 32768
	bf r1, .LBB0_5
	mov r0, r6
	mov r1, r7
	bl pw_pulses_power
	bu .LBB0_5
.LBB0_6:
	ldw r10, sp[3]
	ldw r9, sp[4]
	ldw r8, sp[5]
	ldw r7, sp[6]
	ldw r6, sp[7]
	ldw r5, sp[8]
	ldw r4, sp[9]
	retsp 10
	.cc_bottom prepare.function
.Lfunc_end0:
	.size	prepare, .Lfunc_end0-prepare

	.ident	"Debian clang version 14.0.6"
	.section	".note.GNU-stack","",@progbits
