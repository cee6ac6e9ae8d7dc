// The kernels of the controller as a program of its own, to be measured. Thread 0 stands for the thread that speaks USB:
// it never pauses, and passes on the address of a block that appears in `job`. Sorting threads check and sort the
// block: one that leads, and those of HELPER_1 to HELPER_3 that are 1. If it is accepted the last thread sends the slices and the commits.

	.equ HELPER_1, 1
	.equ HELPER_2, 1
	.equ HELPER_3, 0
	.equ BUSY, 0			// 1: one more thread never pauses, as the sender may

	.globl start, received, judged, decided, sorted
	.text
	.p2align 2
	.type start,@function
start:
	ldap r11, _cp
	set cp, r11
	ldap r11, _dp
	set dp, r11
	ldap r11, stack
	set sp, r11
	bl prepare
	getr r4, 2			// to the leader
	getr r5, 2
	setd res[r4], r5
	getr r6, 2			// from it to the sender
	getr r7, 2
	setd res[r6], r7
	getr r8, 2			// to the link
	getr r9, 4
	ldap r11, send
	init t[r9]:pc, r11
	ldap r11, sending
	init t[r9]:cp, r11
	set t[r9]:r0, r7
	set t[r9]:r1, r8
	start t[r9]
	getr r9, 4
	ldap r11, lead
	init t[r9]:pc, r11
	ldap r11, task_0
	init t[r9]:cp, r11
	stw r5, r11[10]
	stw r6, r11[11]
	start t[r9]
	.if BUSY
	getr r9, 4
	ldap r11, busy
	init t[r9]:pc, r11
	start t[r9]
	.endif
	ldap r11, job
	ldc r1, 0
usb:
	ldw r0, r11[0]
	bf r0, usb
received:
	out res[r4], r0
	stw r1, r11[0]
	bu usb
	.size start, .-start

	.if BUSY
busy:
	add r0, r0, 1
	bu busy
	.endif

// A thread beside the leader; cp points to its task. It waits for the block, for all codes, and for all slices.
	.p2align 2
	.type help,@function
help:
	ssync
	bl scatter
	ssync
	bl pack
	ssync
	bu help
	.size help, .-help

	.macro HELPER number
	.if HELPER_\number
	getst r2, res[r0]
	ldap r11, help
	init t[r2]:pc, r11
	ldap r11, task_\number
	init t[r2]:cp, r11
	.endif
	.endm

	.p2align 2
	.type lead,@function
lead:
	getr r0, 3
	HELPER 1
	HELPER 2
	HELPER 3
	ldap r11, leading
	stw r0, r11[0]
	msync res[r0]			// starts them
.Lblock:
	ldw r0, cp[10]
	ldw r1, cp[6]
	ldap r11, leading
	ldw r2, r11[0]
	in r0, res[r0]
	stw r0, r1[0]
	ldc r3, 3
	ld8u r4, r0[r3]
	lsu r4, r4, r3			// UPDATE and SLOT have pulses; this stays in r4
	bf r4, .Lunshared
	msync res[r2]			// they begin to scatter
.Lunshared:
	bl block_crc
	ldap r11, leading
	ldw r2, r11[1]
	set sp, r2
	mov r1, r0
	ldw r2, cp[6]
	ldw r0, r2[0]
	ldap r11, _cp
	set cp, r11
	ldap r11, _dp
	set dp, r11
	bl judge
	ldap r11, task_0
	set cp, r11
	ldap r11, verdict
	stw r0, r11[0]
	bt r4, .Lshared
	mov r3, r0
	bu decided
.Lshared:
	bl scatter
	ldap r11, leading
	ldw r2, r11[0]
	msync res[r2]			// they begin to pack
	ldap r11, found
	ldw r0, r11[0]
	ldw r1, r11[2]
	add r0, r0, r1
	ldw r1, r11[4]
	add r0, r0, r1
	ldw r1, r11[6]
	add r0, r0, r1			// total drive
	ldw r2, r11[1]
	ldw r1, r11[3]
	or r2, r2, r1
	ldw r1, r11[5]
	or r2, r2, r1
	ldw r1, r11[7]
	or r2, r2, r1			// below 0 if a pulse is reserved
	ldap r11, verdict
	ldw r3, r11[0]
	stw r0, r11[1]
	bt r3, judged			// a reason already: the pulses do not matter
	ldc r5, 0
	lss r4, r2, r5
	bf r4, .Lvalid
	ldc r3, 7			// PULSE
	bu .Lreason
.Lvalid:
	ldap r11, limit
	ldw r5, r11[0]
	ldap r11, verdict
	lsu r4, r5, r0
	bf r4, judged
	ldc r3, 14			// DRIVE
.Lreason:
	stw r3, r11[0]
judged:
	bl pack
	ldap r11, leading
	ldw r2, r11[0]
	ldap r11, verdict
	ldw r3, r11[0]
	msync res[r2]			// all have packed
decided:
	ldw r4, cp[6]
	ldw r5, r4[1]
	stw r5, r11[2]
	bt r3, .Lblock			// refused
	ldw r0, r4[0]
	ldc r1, 3
	ld8u r0, r0[r1]
	eq r0, r0, 1
	bf r0, .Lblock			// no UPDATE: what stores send is not measured here
sorted:
	ldw r0, cp[11]
	out res[r0], r5
	ldap r11, leading
	ldw r1, r11[2]
	stw r5, r11[2]			// the next block's go into the other half
	stw r1, r4[1]
	bu .Lblock
	.size lead, .-lead

	.section .dp.data,"awd",@progbits
	.p2align 2
leading:
	.long 0, stack_of_leader, slices+480
sending:
	.long period, checksums, 0xEDB88320, 0x00000102, 0x000A0102, 0x00000202, 0x000A0202

	.section .dp.bss,"awd",@nobits
	.p2align 2
	.space 1024
stack:
	.space 64
	.space 1024
stack_of_leader:
	.space 64
