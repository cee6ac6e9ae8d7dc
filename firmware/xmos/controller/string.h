/* What the reference's sources need of it. The compiler replaces short copies by loads and stores; firmware/xs1/runtime.s has the
   functions for the others. */
#ifndef PW_XS1_STRING_H
#define PW_XS1_STRING_H

#include <stddef.h>

void *memcpy(void *to, const void *from, size_t size);
void *memset(void *to, int value, size_t size);
int memcmp(const void *a, const void *b, size_t size);
#define memcpy __builtin_memcpy
#define memset __builtin_memset
#define memcmp __builtin_memcmp

#endif
