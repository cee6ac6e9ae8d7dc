# Made by clang from sta.c; do not edit.
# sha256 of it and what it includes: 74a73979b42bf66198711cc12593dce45f8b524fc19fd0c84a9768e290110305
	.text
	.globl	pw_state_allows
	.p2align	2
	.type	pw_state_allows,@function
	.cc_top pw_state_allows.function,pw_state_allows
pw_state_allows:
	ldc r2, 6
	lsu r3, r2, r0
	ldc r2, 0
	bt r3, .LBB0_3
	ldc r3, 12
	lsu r3, r3, r1
	bt r3, .LBB0_3
	ldaw r11, cp[followers]
	ldc r2, 13
	lmul r0, r1, r0, r2, r1, r11
	ldc r0, 0
	ld8u r0, r1[r0]
	eq r0, r0, 0
	eq r2, r0, 0
.LBB0_3:
	mov r0, r2
	retsp 0
	.cc_bottom pw_state_allows.function
.Lfunc_end0:
	.size	pw_state_allows, .Lfunc_end0-pw_state_allows

	.globl	pw_state_after
	.p2align	2
	.type	pw_state_after,@function
	.cc_top pw_state_after.function,pw_state_after
pw_state_after:
	ldc r2, 6
	lsu r2, r2, r0
	bt r2, .LBB1_4
	ldc r2, 12
	lsu r2, r2, r1
	bt r2, .LBB1_4
	ldaw r11, cp[followers]
	ldc r2, 13
	lmul r1, r2, r0, r2, r1, r11
	ldc r1, 0
	ld8u r1, r2[r1]
	bf r1, .LBB1_4
	sub r0, r1, 1
.LBB1_4:
	retsp 0
	.cc_bottom pw_state_after.function
.Lfunc_end1:
	.size	pw_state_after, .Lfunc_end1-pw_state_after

	.globl	pw_state_enabled
	.p2align	2
	.type	pw_state_enabled,@function
	.cc_top pw_state_enabled.function,pw_state_enabled
pw_state_enabled:
	sub r0, r0, 1
	mkmsk r1, 2
	lsu r0, r0, r1
	retsp 0
	.cc_bottom pw_state_enabled.function
.Lfunc_end2:
	.size	pw_state_enabled, .Lfunc_end2-pw_state_enabled

	.section	.cp.rodata,"ac",@progbits
	.cc_top followers.data,followers
	.p2align	2
	.type	followers,@object
	.size	followers, 91
followers:
	.ascii	"\002\000\000\000\000\000\005\000\000\006\000\007\001"
	.ascii	"\000\001\003\004\000\001\005\000\001\006\000\007\001"
	.ascii	"\000\001\000\004\002\001\005\000\001\006\000\007\001"
	.ascii	"\000\001\003\000\002\000\005\000\001\000\000\007\001"
	.ascii	"\000\000\000\000\000\000\000\001\000\000\000\007\001"
	.ascii	"\000\000\000\000\000\000\005\000\001\000\001\000\001"
	.ascii	"\000\000\000\000\000\000\000\000\000\000\000\000\001"
	.cc_bottom followers.data
	.ident	"Debian clang version 14.0.6"
	.section	".note.GNU-stack","",@progbits
