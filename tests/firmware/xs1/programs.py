"""Programs in C that make clang use everything that the assembler must know."""

STUBS = """
	.macro stub name
	.globl \\name
\\name:	retsp 0
	.endm
	stub __addsf3; stub __subsf3; stub __mulsf3; stub __divsf3; stub __muldf3; stub __fixsfsi; stub __floatsisf
	stub outside
"""
"""What C calls but the runtime library lacks."""

DATA = r"""
typedef unsigned char u8; typedef unsigned short u16; typedef unsigned u;
int g = 5; static int s; int bss[300]; static const int tab[5] = {1, 2, 3, 4, 5}; static u8 big[4000];
const char *str = "hello"; const int ctab[3] = {7, 8, 9}; u16 half[4] = {1, 2, 3, 4}; int *pg = &g + 2;
int (*fp)(int); struct {u8 a; u16 b; u c; char name[6];} st = {1, 2, 3, "ab\n\"c"}; static volatile int vol;
double real = 3.5; unsigned long long q = 0x123456789abcdefULL; __attribute__((weak)) int wk = 3;
__attribute__((aligned(16))) int al = 2; const short sh[3] = {1, -2, 3}; const u8 by[] = {1, 2, 255, 0, 4};
const char w[] = "quote\" back\\ tab\t nul\0x \x7f\xff # end, // ; 'x"; __thread int tl;
int f1(int a) { s += a; big[a]++; return g + tab[a & 3] + ctab[a] + half[a] + vol + tl; }
int ld(int i) { return sh[i] + by[i] + w[i]; }
char *mid(void) { return (char *)big + 1001; } const int *tabp(int i) { return &tab[i]; }
int st16f(u16 *p, int i, int v) { p[i] = v; return p[i]; } short ld16(short *p) { return p[3]; }
signed char ld8s(signed char *p) { return p[1]; } void all(int *p) { for (;;) *p = bss[vol]; }
typedef int (*fn)(int); static const fn table[] = {f1, ld, f1}; int callt(int i, int a) { return table[i](a); }
fn getf(int i) { return i ? f1 : ld; } const char *two(int i) { return i ? "abc" : "def"; }
void *lab(int i) { static void *t[] = {&&a, &&b}; goto *t[i]; a: return (void *)1; b: return (void *)2; }
"""

BRANCHES = r"""
#define C(n) case n: x += x * n + (n << 2) + g[x & 7]; g[n & 7] += x; break;
#define D(n) C(n) C(n+1) C(n+2) C(n+3) C(n+4)
volatile int g[8]; extern int outside(int);
int few(int a) { switch (a) { case 0: return 5; case 1: return outside(2); case 2: return -7; case 3: return 99;
    case 4: return g[3]; case 5: return g[1] + outside(1); case 6: return 1 << g[0]; } return 0; }
int far(int k, int x) { for (int i = 0; i < 4; i++) switch (k + i) { D(0) D(5) D(10) D(15) D(20) } return x; }
int many(int k, int x) { for (int i = 0; i < 4; i++) switch (k + i) {
    D(0) D(5) D(10) D(15) D(20) D(25) D(30) D(35)} return x; }
int loop(int n) { volatile int x[200]; for (int i = 0; i < 200; i++) x[i] = n; return x[n]; }
int big_consts(int a) { return a * 100000 + 0x12345678; }
void trap(void) { __builtin_trap(); }
int asm_(unsigned r) { int v; __asm__ volatile("in %0, res[%1]" : "=r"(v) : "r"(r));
    __asm__ volatile("1: outct res[%0], 1\n\tchkct res[%0], 1; bt %0, 1b" :: "r"(r)); return v; }
"""

NUMBERS = r"""
typedef unsigned u; typedef unsigned long long ull; typedef long long ll;
ull m64(ull a, ull b) { return a * b; } ull d64(ull a, ull b) { return a / b; } ll sd64(ll a, ll b) { return a / b; }
ull r64(ull a, ull b) { return a % b; } ll sr64(ll a, ll b) { return a % b; } ull sh(ull a, int n) { return a << n; }
ull sr(ull a, int n) { return a >> n; } ll sar(ll a, int n) { return a >> n; } ull add64(ull a, ull b) { return a + b; }
ull sub64(ull a, ull b) { return a - b; } ull c5(ull a) { return a << 5; } int less(ull a, ull b) { return a < b; }
u rot(u a, u n) { return a << n | a >> (32 - n); } u lead(u a) { return __builtin_clz(a); }
u trail(u a) { return __builtin_ctz(a); } u pop(u a) { return __builtin_popcount(a); }
u bs(u a) { return __builtin_bswap32(a); } int divi(int a, int b) { return a / b + a % b; }
u divu(u a, u b) { return a / b + a % b; } u mulhi(u a, u b) { return ((ull)a * b) >> 32; }
int mulhis(int a, int b) { return ((ll)a * b) >> 32; } ll mac(ll a, int b, int c) { return a + (ll)b * c; }
float fadd(float a, float b) { return a * b + a / b - b; } double dm(double a, double b) { return a * b; }
int f2i(float a) { return a; } float i2f(int a) { return a; }
"""

MEMORY = r"""
#include <stdarg.h>
typedef unsigned u; void *memcpy(void *, const void *, u); void *memset(void *, int, u);
void *memmove(void *, const void *, u); int memcmp(const void *, const void *, u); int outside(int);
struct B { int x[40]; }; struct B cp(struct B *p) { return *p; } void mc(char *a, char *b, u n) { memcpy(a, b, n); }
void ms(char *a, u n) { memset(a, 0, n); } void mm(char *a, char *b, u n) { memmove(a, b, n); }
int mcmp(char *a, char *b) { return memcmp(a, b, 33); } void cpw(int *a, int *b) { memcpy(a, b, 400); }
int va(int n, ...) { va_list l; va_start(l, n); int t = 0; while (n--) t += va_arg(l, int); va_end(l); return t; }
int useva(void) { return va(3, 1, 2, 3); } int args(int a, int b, int c, int d, int e, int f) { return a + e * f; }
int useargs(void) { return args(1, 2, 3, 4, 5, 6); } int un(char *p) { int x; __builtin_memcpy(&x, p, 4); return x; }
struct __attribute__((packed)) P { char c; int x; }; void pks(struct P *p, int v) { p->x = v; }
int room(int n) { int *p = __builtin_alloca(n * 4); p[0] = n; return outside((int)p); }
"""

ALL = {"data": DATA, "branches": BRANCHES, "numbers": NUMBERS, "memory": MEMORY}
