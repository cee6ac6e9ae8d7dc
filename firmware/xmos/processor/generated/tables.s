# Made by clang from tables.c; do not edit.
# sha256 of it and what it includes: 801fc5f8c952b76c19f274effb36763a1d9a0a881b04899905e7b4a569d2888a
	.text
	.section	.cp.rodata.cst4,"aMc",@progbits,4
	.p2align	2
.LCPI0_0:
	.long	4294967246
	.text
	.globl	memories_begin
	.p2align	2
	.type	memories_begin,@function
	.cc_top memories_begin.function,memories_begin
memories_begin:
	extsp 7
	stw r4, sp[6]
	stw r5, sp[5]
	stw r6, sp[4]
	stw r7, sp[3]
	stw r8, sp[2]
	stw r9, sp[1]
	stw r10, sp[0]
	ldaw r0, dp[play_ring+64]
	stw r0, dp[play_ring+60]
	ldaw r0, dp[play_ring]
	ldaw r1, dp[play_ring+128]
	stw r1, dp[play_ring+124]
	ldaw r1, dp[play_ring+192]
	stw r1, dp[play_ring+188]
	ldaw r1, dp[play_ring+256]
	stw r1, dp[play_ring+252]
	ldaw r1, dp[play_ring+320]
	stw r1, dp[play_ring+316]
	ldaw r1, dp[play_ring+384]
	stw r1, dp[play_ring+380]
	ldaw r1, dp[play_ring+448]
	stw r1, dp[play_ring+444]
	stw r0, dp[play_ring+508]
	ldaw r0, dp[handle_ring+64]
	stw r0, dp[handle_ring+60]
	ldaw r0, dp[handle_ring]
	ldaw r1, dp[handle_ring+128]
	stw r1, dp[handle_ring+124]
	ldaw r1, dp[handle_ring+192]
	stw r1, dp[handle_ring+188]
	ldaw r1, dp[handle_ring+256]
	stw r1, dp[handle_ring+252]
	ldaw r1, dp[handle_ring+320]
	stw r1, dp[handle_ring+316]
	ldaw r1, dp[handle_ring+384]
	stw r1, dp[handle_ring+380]
	ldaw r1, dp[handle_ring+448]
	stw r1, dp[handle_ring+444]
	ldaw r1, dp[handle_ring+512]
	stw r1, dp[handle_ring+508]
	ldaw r1, dp[handle_ring+576]
	stw r1, dp[handle_ring+572]
	ldaw r1, dp[handle_ring+640]
	stw r1, dp[handle_ring+636]
	ldaw r1, dp[handle_ring+704]
	stw r1, dp[handle_ring+700]
	ldaw r1, dp[handle_ring+768]
	stw r1, dp[handle_ring+764]
	stw r0, dp[handle_ring+828]
	ldaw r0, dp[silent_table]
	stw r0, dp[next_table]
	mkmsk r1, 1
	ldc r9, 99
	ldc r11, 0
	ldaw r7, dp[pulse_ends]
	ldc r8, 100
	mov r6, r9
	bu .LBB0_1
.LBB0_7:
	add r1, r1, 1
	sub r9, r9, 1
	ldc r10, 26
	eq r0, r1, r10
	bt r0, .LBB0_8
.LBB0_1:
	shl r10, r1, 7
	mov r3, r11
	bu .LBB0_2
.LBB0_6:
	add r2, r5, r2
	or r4, r3, r10
	ldaw r5, dp[pulse_begins]
	st8 r0, r4[r5]
	st8 r2, r4[r7]
	add r3, r3, 1
	eq r0, r3, r8
	bt r0, .LBB0_7
.LBB0_2:
	add r0, r9, r3
	lsu r5, r6, r0
	ldw r2, cp[.LCPI0_0]
	bt r5, .LBB0_4
	mov r2, r11
.LBB0_4:
	shr r0, r0, 1
	add r0, r2, r0
	add r2, r0, r1
	ldc r4, 50
	lsu r4, r2, r4
	mov r5, r11
	bt r4, .LBB0_6
	ldc r5, 206
	bu .LBB0_6
.LBB0_8:
	ldc r1, 0
	ldaw r2, dp[widths]
	ldc r3, 256
	mov r4, r1
	bu .LBB0_9
.LBB0_18:
	add r4, r4, 1
	eq r0, r4, r3
	bt r0, .LBB0_19
.LBB0_9:
	mul r0, r4, r10
	add r5, r0, r2
	mov r7, r1
	mov r6, r1
	bu .LBB0_10
.LBB0_14:
	mov r7, r8
.LBB0_17:
	st8 r7, r5[r6]
	add r6, r6, 1
	eq r0, r6, r10
	bt r0, .LBB0_18
.LBB0_10:
	ldaw r11, cp[amplitudes]
	lsu r0, r6, r7
	mov r8, r7
	bt r0, .LBB0_12
	mov r8, r6
.LBB0_12:
	ldw r0, r11[r6]
	mul r9, r0, r4
.LBB0_13:
	eq r0, r8, r7
	bt r0, .LBB0_14
	add r0, r7, 1
	ldaw r11, cp[bounds+4]
	ldw r11, r11[r7]
	lsu r11, r9, r11
	mov r7, r0
	bf r11, .LBB0_13
	sub r7, r0, 1
	bu .LBB0_17
.LBB0_19:
	ldw r10, sp[0]
	ldw r9, sp[1]
	ldw r8, sp[2]
	ldw r7, sp[3]
	ldw r6, sp[4]
	ldw r5, sp[5]
	ldw r4, sp[6]
	ldaw sp, sp[7]
	retsp 0
	.cc_bottom memories_begin.function
.Lfunc_end0:
	.size	memories_begin, .Lfunc_end0-memories_begin

	.section	.dp.bss,"awd",@nobits
	.cc_top play_ring.data,play_ring
	.globl	play_ring.globound
.set play_ring.globound, 8
	.globl	play_ring
	.p2align	2
	.type	play_ring,@object
	.size	play_ring, 512
play_ring:
	.space	512
	.cc_bottom play_ring.data
	.cc_top handle_ring.data,handle_ring
	.globl	handle_ring.globound
.set handle_ring.globound, 13
	.globl	handle_ring
	.p2align	2
	.type	handle_ring,@object
	.size	handle_ring, 832
handle_ring:
	.space	832
	.cc_bottom handle_ring.data
	.cc_top silent_table.data,silent_table
	.globl	silent_table.globound
.set silent_table.globound, 50
	.globl	silent_table
	.p2align	2
	.type	silent_table,@object
	.size	silent_table, 200
silent_table:
	.space	200
	.cc_bottom silent_table.data
	.cc_top widths.data,widths
	.globl	widths.globound
.set widths.globound, 6662
	.globl	widths
	.p2align	2
	.type	widths,@object
	.size	widths, 6662
widths:
	.space	6662
	.cc_bottom widths.data
	.cc_top slots.data,slots
	.globl	slots.globound
.set slots.globound, 256
	.globl	slots
	.p2align	2
	.type	slots,@object
	.size	slots, 12288
slots:
	.space	12288
	.cc_bottom slots.data
	.cc_top entries.data,entries
	.globl	entries.globound
.set entries.globound, 1024
	.globl	entries
	.p2align	2
	.type	entries,@object
	.size	entries, 4096
entries:
	.space	4096
	.cc_bottom entries.data
	.cc_top samples.data,samples
	.globl	samples.globound
.set samples.globound, 4096
	.globl	samples
	.p2align	2
	.type	samples,@object
	.size	samples, 4096
samples:
	.space	4096
	.cc_bottom samples.data
	.cc_top no_edges.data,no_edges
	.globl	no_edges.globound
.set no_edges.globound, 50
	.globl	no_edges
	.p2align	2
	.type	no_edges,@object
	.size	no_edges, 200
no_edges:
	.space	200
	.cc_bottom no_edges.data
	.cc_top tables.data,tables
	.globl	tables.globound
.set tables.globound, 3
	.globl	tables
	.p2align	2
	.type	tables,@object
	.size	tables, 600
tables:
	.space	600
	.cc_bottom tables.data
	.cc_top pulse_begins.data,pulse_begins
	.globl	pulse_begins.globound
.set pulse_begins.globound, 4096
	.globl	pulse_begins
	.p2align	2
	.type	pulse_begins,@object
	.size	pulse_begins, 4096
pulse_begins:
	.space	4096
	.cc_bottom pulse_begins.data
	.cc_top pulse_ends.data,pulse_ends
	.globl	pulse_ends.globound
.set pulse_ends.globound, 4096
	.globl	pulse_ends
	.p2align	2
	.type	pulse_ends,@object
	.size	pulse_ends, 4096
pulse_ends:
	.space	4096
	.cc_bottom pulse_ends.data
	.section	.cp.rodata,"ac",@progbits
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
