// One function of the reference, to be measured alone: thread 0 calls the function whose address is in r4 with r0 to r3,
// among four threads that never pause, as on the controller. If r5 is not 0 it calls that function before.

	.equ SPINNING, 4

	.globl start, called, returned, block, wiring, slices, record
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
	bf r5, .Lprepared
	mov r6, r0
	mov r7, r1
	mov r8, r2
	mov r9, r3
	bla r5
	mov r0, r6
	mov r1, r7
	mov r2, r8
	mov r3, r9
.Lprepared:
	ldc r5, SPINNING
.Lspin:
	getr r6, 4
	ldap r11, spin
	init t[r6]:pc, r11
	start t[r6]
	sub r5, r5, 1
	bt r5, .Lspin
called:
	bla r4
returned:
	mov r0, r0
	waiteu
	.size start, .-start

	.p2align 2
	.type spin,@function
spin:
	add r0, r0, 1
	bu spin
	.size spin, .-spin

	.section .dp.bss,"awd",@nobits
	.p2align 2
block:
	.space 512
wiring:
	.space 640
slices:
	.space 480
record:
	.space 64
	.space 4096
stack:
	.space 64
