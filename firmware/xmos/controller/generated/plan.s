# Made by clang from plan.c; do not edit.
# sha256 of it and what it includes: a9d75ec172e01058e7a08f47d2804f12e6da8ac01b356c60ccb9e52ce2073633
	.text
	.section	.cp.rodata.cst4,"aMc",@progbits,4
	.p2align	2
.LCPI0_0:
	.long	878082202
.LCPI0_1:
	.long	1563749870
.LCPI0_2:
	.long	1563749872
	.text
	.globl	plan_prepare
	.p2align	2
	.type	plan_prepare,@function
	.cc_top plan_prepare.function,plan_prepare
plan_prepare:
	ldaw r11, cp[wiring]
	stw r11, dp[about+24]
	ldaw r0, dp[about]
	stw r0, dp[device+4]
	ldc r0, 18
	stw r0, dp[device+20]
	ldw r0, cp[.LCPI0_0]
	stw r0, dp[device+16]
	ldc r0, 0
	stw r0, dp[device+28]
	ldw r1, cp[.LCPI0_1]
	stw r1, dp[device+24]
	stw r0, dp[device+18568]
	ldw r1, cp[.LCPI0_2]
	stw r1, dp[device+18564]
	ldc r1, 2
	stw r1, dp[device+56]
	ldaw r1, dp[device+76]
	add r1, r1, 2
	ldc r2, 320
	st16 r2, r1[r0]
	mkmsk r1, 32
	stw r1, dp[device+18600]
	stw r1, dp[device+18596]
	ldaw r1, dp[device+92]
	mkmsk r2, 1
	st8 r2, r1[r0]
	retsp 0
	.cc_bottom plan_prepare.function
.Lfunc_end0:
	.size	plan_prepare, .Lfunc_end0-plan_prepare

	.globl	plan
	.p2align	2
	.type	plan,@function
	.cc_top plan.function,plan
plan:
	entsp 12
	stw r4, sp[11]
	ldaw r0, dp[device]
	ldw r1, dp[device+16]
	ldw r2, dp[device+20]
	ldaw r4, sp[4]
	stw r4, sp[3]
	stw r2, sp[2]
	stw r1, sp[1]
	ldaw r11, cp[block]
	mov r2, r11
	ldc r1, 0
	ldc r3, 512
	bl pw_device_block
	ldaw r0, dp[record]
	mov r1, r4
	bl pw_ack_put
	ldw r4, sp[11]
	retsp 12
	.cc_bottom plan.function
.Lfunc_end1:
	.size	plan, .Lfunc_end1-plan

	.section	.dp.bss,"awd",@nobits
	.cc_top about.data,about
	.p2align	2
	.type	about,@object
	.size	about, 32
about:
	.space	32
	.cc_bottom about.data
	.cc_top device.data,device
	.globl	device
	.p2align	2
	.type	device,@object
	.size	device, 29956
device:
	.space	29956
	.cc_bottom device.data
	.ident	"Debian clang version 14.0.6"
	.section	".note.GNU-stack","",@progbits
