// The share of each sorting thread, and the memory that the threads have in common.
//
// They share 40 pieces of 8 pulses: SCATTER_n and PACK_n are how many pieces thread n scatters and packs.
// Thread 0 also checks the block, so it scatters fewer.

	.equ SCATTER_0, 8
	.equ SCATTER_1, 16
	.equ SCATTER_2, 16
	.equ SCATTER_3, 0
	.equ PACK_0, 12
	.equ PACK_1, 14
	.equ PACK_2, 14
	.equ PACK_3, 0

	.globl task_0, task_1, task_2, task_3, found, job, current, verdict, places, codes, powers, wiring, slices
	.globl block, period, checksums, limit

// A task, in words: pieces to scatter, the places of their channels, where their pulses are in a block; pieces to pack,
// their codes, where they go in ten slices; what all share; powers; what is found; the polynomial of the CRC-32; and for
// thread 0 the channel ends from the thread of USB and to the sender.
	.macro TASK scatter, scattered, pack, packed, found
	.long \scatter, places+32*(\scattered), 32+12*(\scattered), \pack, codes+32*(\packed), 12*(\packed)
	.long current, powers, \found, 0xEDB88320, 0, 0
	.endm

	.section .dp.data,"awd",@progbits
	.p2align 2
task_0:
	TASK SCATTER_0, 0, PACK_0, 0, found
task_1:
	TASK SCATTER_1, SCATTER_0, PACK_1, PACK_0, found+8
task_2:
	TASK SCATTER_2, SCATTER_0+SCATTER_1, PACK_2, PACK_0+PACK_1, found+16
task_3:
	TASK SCATTER_3, SCATTER_0+SCATTER_1+SCATTER_2, PACK_3, PACK_0+PACK_1+PACK_2, found+24
current:		// the block that is sorted, and where its slices go
	.long 0, slices
job:			// the address of a block, for the thread of USB to pass on; 0 is none
	.long 0
verdict:		// of the last block: reason (ACK-003), total drive, and its slices
	.long 0, 0, 0
limit:			// most total drive (SAF-006)
	.long 320000
period:			// for the commits
	.long 1000, 0

	.section .dp.bss,"awd",@nobits
	.p2align 2
found:			// by each sorting thread: total drive, and below 0 if a pulse is reserved
	.space 32
checksums:		// of the commits
	.space 40
places:			// in `codes`, an address for each pulse in array order
	.space 1280
codes:			// pulses in the order of channels
	.space 1280
slices:			// ten of 48 bytes, twice: one half is sent while the other is written
	.space 960
block:
	.space 512
wiring:			// the channel of each pulse, 16 bits each
	.space 640
powers:			// of each of 4096 pulses, 16 bits each
	.space 8192
