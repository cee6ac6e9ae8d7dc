# The functions that clang calls for the XS1: numbers of 64 bits, memory. Operands are in r0 to r3, results in r0 and
# r1, and r4 to r10 are kept. A number of 64 bits has its lower half in the register of the lower number.
# Each part from .cc_top to .cc_bottom is only linked if something refers to it. There is no floating point.

	.text

# void *memcpy(void *to, const void *from, unsigned count): from the last byte to the first.
# void *__memcpy_4(void *to, const void *from, unsigned count): the same for whole words.
	.cc_top memcpy.function, memcpy
	.globl memcpy
	.globl __memcpy_4
	.type memcpy, @function
	.type __memcpy_4, @function
	.p2align 2
memcpy:
	or r3, r0, r1
	zext r3, 2
	bt r3, .Lcopy_bytes
.Lcopy_tail:
	add r3, r2, 0
	zext r3, 2
	bf r3, __memcpy_4
	sub r2, r2, 1
	ld8u r3, r1[r2]
	st8 r3, r0[r2]
	bu .Lcopy_tail
.Lcopy_bytes:
	bf r2, .Lcopy_end
.Lcopy_byte:
	sub r2, r2, 1
	ld8u r3, r1[r2]
	st8 r3, r0[r2]
	bt r2, .Lcopy_byte
.Lcopy_end:
	retsp 0
	.size memcpy, . - memcpy

__memcpy_4:
	shr r2, r2, 2
	bf r2, .Lcopied
.Lcopy_word:
	sub r2, r2, 1
	ldw r3, r1[r2]
	stw r3, r0[r2]
	bt r2, .Lcopy_word
.Lcopied:
	retsp 0
	.size __memcpy_4, . - __memcpy_4
	.cc_bottom memcpy.function

# void *memmove(void *to, const void *from, unsigned count)
	.cc_top memmove.function, memmove
	.globl memmove
	.type memmove, @function
	.p2align 2
memmove:
	sub r3, r1, r0
	lsu r3, r3, r2
	bt r3, .Lmove_upwards
	bu memcpy                       # downwards is right, or they do not overlap
.Lmove_upwards:
	or r3, r0, r1
	zext r3, 2
	bf r3, .Lmove_words
	ldc r3, 0
	bu .Lmove_bytes
.Lmove_words:
	extsp 1
	stw r4, sp[0]
	shr r4, r2, 2
	ldc r3, 0
	bu .Lmove_more_words
.Lmove_word:
	ldw r11, r1[r3]
	stw r11, r0[r3]
	add r3, r3, 1
.Lmove_more_words:
	lsu r11, r3, r4
	bt r11, .Lmove_word
	shl r3, r3, 2
	ldw r4, sp[0]
	ldaw sp, sp[1]
	bu .Lmove_bytes
.Lmove_byte:
	ld8u r11, r1[r3]
	st8 r11, r0[r3]
	add r3, r3, 1
.Lmove_bytes:
	lsu r11, r3, r2
	bt r11, .Lmove_byte
	retsp 0
	.size memmove, . - memmove
	.cc_bottom memmove.function

# void *memset(void *to, int value, unsigned count)
	.cc_top memset.function, memset
	.globl memset
	.type memset, @function
	.p2align 2
memset:
	add r3, r0, 0
	zext r3, 2
	bt r3, .Lset_bytes
	zext r1, 8
	shl r3, r1, 8
	or r1, r1, r3
	shl r3, r1, 16
	or r1, r1, r3
.Lset_tail:
	add r3, r2, 0
	zext r3, 2
	bf r3, .Lset_words
	sub r2, r2, 1
	st8 r1, r0[r2]
	bu .Lset_tail
.Lset_words:
	shr r2, r2, 2
	bf r2, .Lset_end
.Lset_word:
	sub r2, r2, 1
	stw r1, r0[r2]
	bt r2, .Lset_word
	retsp 0
.Lset_bytes:
	bf r2, .Lset_end
.Lset_byte:
	sub r2, r2, 1
	st8 r1, r0[r2]
	bt r2, .Lset_byte
.Lset_end:
	retsp 0
	.size memset, . - memset
	.cc_bottom memset.function

# int memcmp(const void *a, const void *b, unsigned count)
	.cc_top memcmp.function, memcmp
	.globl memcmp
	.type memcmp, @function
	.p2align 2
memcmp:
	extsp 1
	stw r4, sp[0]
	ldc r11, 0
	bu .Lcompare_more
.Lcompare_byte:
	ld8u r3, r0[r11]
	ld8u r4, r1[r11]
	sub r3, r3, r4
	bt r3, .Lcompare_end
	add r11, r11, 1
.Lcompare_more:
	ldc r3, 0
	lsu r4, r11, r2
	bt r4, .Lcompare_byte
.Lcompare_end:
	add r0, r3, 0
	ldw r4, sp[0]
	ldaw sp, sp[1]
	retsp 0
	.size memcmp, . - memcmp
	.cc_bottom memcmp.function

# unsigned __misaligned_load(const void *from)
	.cc_top __misaligned_load.function, __misaligned_load
	.globl __misaligned_load
	.type __misaligned_load, @function
	.p2align 2
__misaligned_load:
	ldc r3, 3
	ldc r1, 0
.Lload_byte:
	shl r1, r1, 8
	ld8u r2, r0[r3]
	or r1, r1, r2
	sub r3, r3, 1
	ashr r2, r3, 32
	bf r2, .Lload_byte
	add r0, r1, 0
	retsp 0
	.size __misaligned_load, . - __misaligned_load
	.cc_bottom __misaligned_load.function

# void __misaligned_store(void *to, unsigned value)
	.cc_top __misaligned_store.function, __misaligned_store
	.globl __misaligned_store
	.type __misaligned_store, @function
	.p2align 2
__misaligned_store:
	ldc r3, 0
.Lstore_byte:
	st8 r1, r0[r3]
	shr r1, r1, 8
	add r3, r3, 1
	eq r2, r3, 4
	bf r2, .Lstore_byte
	retsp 0
	.size __misaligned_store, . - __misaligned_store
	.cc_bottom __misaligned_store.function

# Shifts by 0 to 63. The instructions give 0, or the sign, for a shift by 32 or more.
# unsigned long long __ashldi3(unsigned long long value, unsigned bits)
	.cc_top __ashldi3.function, __ashldi3
	.globl __ashldi3
	.type __ashldi3, @function
	.p2align 2
__ashldi3:
	ldc r3, 32
	lsu r11, r2, r3
	bf r11, .Lshift_left_far
	sub r3, r3, r2
	shr r3, r0, r3
	shl r1, r1, r2
	or r1, r1, r3
	shl r0, r0, r2
	retsp 0
.Lshift_left_far:
	sub r2, r2, r3
	shl r1, r0, r2
	ldc r0, 0
	retsp 0
	.size __ashldi3, . - __ashldi3
	.cc_bottom __ashldi3.function

# unsigned long long __lshrdi3(unsigned long long value, unsigned bits)
	.cc_top __lshrdi3.function, __lshrdi3
	.globl __lshrdi3
	.type __lshrdi3, @function
	.p2align 2
__lshrdi3:
	ldc r3, 32
	lsu r11, r2, r3
	bf r11, .Lshift_right_far
	sub r3, r3, r2
	shl r3, r1, r3
	shr r0, r0, r2
	or r0, r0, r3
	shr r1, r1, r2
	retsp 0
.Lshift_right_far:
	sub r2, r2, r3
	shr r0, r1, r2
	ldc r1, 0
	retsp 0
	.size __lshrdi3, . - __lshrdi3
	.cc_bottom __lshrdi3.function

# long long __ashrdi3(long long value, unsigned bits)
	.cc_top __ashrdi3.function, __ashrdi3
	.globl __ashrdi3
	.type __ashrdi3, @function
	.p2align 2
__ashrdi3:
	ldc r3, 32
	lsu r11, r2, r3
	bf r11, .Lshift_signed_far
	sub r3, r3, r2
	shl r3, r1, r3
	shr r0, r0, r2
	or r0, r0, r3
	ashr r1, r1, r2
	retsp 0
.Lshift_signed_far:
	sub r2, r2, r3
	ashr r0, r1, r2
	ashr r1, r1, 32
	retsp 0
	.size __ashrdi3, . - __ashrdi3
	.cc_bottom __ashrdi3.function

# unsigned long long __udivdi3(unsigned long long a, unsigned long long b): with the remainder in r2 and r3.
# Division by 0 traps. A divisor of more than 32 bits: H. S. Warren, Hacker's Delight, 2nd ed., 9-5.
	.cc_top __udivdi3.function, __udivdi3
	.globl __udivdi3
	.type __udivdi3, @function
	.p2align 2
__udivdi3:
	bt r3, .Ldivide_wide
	ldivu r1, r3, r3, r1, r2
	ldivu r0, r2, r3, r0, r2
	ldc r3, 0
	retsp 0
.Ldivide_wide:
	extsp 4
	stw r4, sp[0]
	stw r5, sp[1]
	stw r6, sp[2]
	stw r7, sp[3]
	clz r4, r3
	shl r5, r3, r4                  # r5: the upper 32 bits of the divisor, from its first 1 on
	ldc r6, 32
	sub r6, r6, r4
	shr r6, r2, r6
	or r5, r5, r6
	ldc r6, 31                      # r11, r7: the dividend, halved
	shl r11, r1, r6
	shr r7, r0, 1
	or r7, r7, r11
	shr r11, r1, 1
	ldivu r5, r7, r11, r7, r5
	sub r6, r6, r4
	shr r5, r5, r6                  # r5: the quotient, or 1 more
	bf r5, .Ldivide_rest
	sub r5, r5, 1                   # the quotient, or 1 less
.Ldivide_rest:
	ldc r11, 0
	lmul r7, r6, r5, r2, r11, r11
	mul r4, r5, r3
	add r7, r7, r4
	lsub r4, r0, r0, r6, r11
	lsub r11, r1, r1, r7, r4
	lsu r11, r1, r3
	bt r11, .Ldivide_end
	eq r11, r1, r3
	bf r11, .Ldivide_once
	lsu r11, r0, r2
	bt r11, .Ldivide_end
.Ldivide_once:
	add r5, r5, 1
	ldc r11, 0
	lsub r4, r0, r0, r2, r11
	lsub r11, r1, r1, r3, r4
.Ldivide_end:
	add r2, r0, 0
	add r3, r1, 0
	add r0, r5, 0
	ldc r1, 0
	ldw r4, sp[0]
	ldw r5, sp[1]
	ldw r6, sp[2]
	ldw r7, sp[3]
	ldaw sp, sp[4]
	retsp 0
	.size __udivdi3, . - __udivdi3
	.cc_bottom __udivdi3.function

# unsigned long long __umoddi3(unsigned long long a, unsigned long long b)
	.cc_top __umoddi3.function, __umoddi3
	.globl __umoddi3
	.type __umoddi3, @function
	.p2align 2
__umoddi3:
	entsp 1
	bl __udivdi3
	add r0, r2, 0
	add r1, r3, 0
	retsp 1
	.size __umoddi3, . - __umoddi3
	.cc_bottom __umoddi3.function

# The absolute values of two numbers, in place; r11 becomes 0.
	.cc_top magnitudes.function, magnitudes
	.type magnitudes, @function
	.p2align 2
magnitudes:
	extsp 1
	stw r4, sp[0]
	ldc r11, 0
	ashr r4, r1, 32
	bf r4, .Lmagnitude_second
	lsub r4, r0, r11, r0, r11
	neg r1, r1
	sub r1, r1, r4
.Lmagnitude_second:
	ashr r4, r3, 32
	bf r4, .Lmagnitudes_end
	lsub r4, r2, r11, r2, r11
	neg r3, r3
	sub r3, r3, r4
.Lmagnitudes_end:
	ldw r4, sp[0]
	ldaw sp, sp[1]
	retsp 0
	.size magnitudes, . - magnitudes
	.cc_bottom magnitudes.function

# long long __divdi3(long long a, long long b): rounded towards 0.
	.cc_top __divdi3.function, __divdi3
	.globl __divdi3
	.type __divdi3, @function
	.p2align 2
__divdi3:
	entsp 2
	stw r4, sp[1]
	xor r4, r1, r3
	bl magnitudes
	bl __udivdi3
	ashr r4, r4, 32
	bf r4, .Lquotient_end
	ldc r11, 0
	lsub r4, r0, r11, r0, r11
	neg r1, r1
	sub r1, r1, r4
.Lquotient_end:
	ldw r4, sp[1]
	retsp 2
	.size __divdi3, . - __divdi3
	.cc_bottom __divdi3.function

# long long __moddi3(long long a, long long b): with the sign of a.
	.cc_top __moddi3.function, __moddi3
	.globl __moddi3
	.type __moddi3, @function
	.p2align 2
__moddi3:
	entsp 2
	stw r4, sp[1]
	add r4, r1, 0
	bl magnitudes
	bl __udivdi3
	add r0, r2, 0
	add r1, r3, 0
	ashr r4, r4, 32
	bf r4, .Lremainder_end
	ldc r11, 0
	lsub r4, r0, r11, r0, r11
	neg r1, r1
	sub r1, r1, r4
.Lremainder_end:
	ldw r4, sp[1]
	retsp 2
	.size __moddi3, . - __moddi3
	.cc_bottom __moddi3.function
