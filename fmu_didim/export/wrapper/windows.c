/* What an FMU needs at run time on Windows beside ucrtbase.dll, which every Windows has since 10.
 *
 * Linked with this file, a library needs no C run-time library of the compiler's own: MinGW's, in ziglang, is compiled
 * the first time it is used, for minutes. Such a library has no constructors and no thread-local data, so it has
 * nothing to start. It is no source of the FMU: other compilers bring all this along.
 */
#include <math.h>
#include <stdarg.h>
#include <stddef.h>

int _fltused = 0; /* the mark of objects that use floating-point numbers */

int __stdcall DllMainCRTStartup(void *module, unsigned int reason, void *reserved) {
    (void)module, (void)reason, (void)reserved;
    return 1;
}

/* Touches each page of a large stack frame, of rax bytes, in turn, so that Windows can grow the stack. */
__attribute__((naked)) void ___chkstk_ms(void) {
    __asm__("pushq %rcx\n\t"
            "pushq %rax\n\t"
            "leaq 24(%rsp), %rcx\n" /* the caller's stack pointer */
            "1:\n\t"
            "cmpq $4096, %rax\n\t"
            "jb 2f\n\t"
            "subq $4096, %rcx\n\t"
            "orb $0, (%rcx)\n\t"
            "subq $4096, %rax\n\t"
            "jmp 1b\n"
            "2:\n\t"
            "subq %rax, %rcx\n\t"
            "orb $0, (%rcx)\n\t"
            "popq %rax\n\t"
            "popq %rcx\n\t"
            "ret\n");
}

int __stdio_common_vsprintf(unsigned long long options, char *buffer, size_t size, const char *format, void *locale,
                            va_list arguments);

int vsnprintf(char *buffer, size_t size, const char *format, va_list arguments) {
    /* Option 2: as C99 has it, always with a zero at the end. */
    return __stdio_common_vsprintf(2, buffer, size, format, NULL, arguments);
}

int snprintf(char *buffer, size_t size, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    const int length = vsnprintf(buffer, size, format, arguments);
    va_end(arguments);
    return length;
}

static unsigned long long bits_of(double x) {
    const union { double number; unsigned long long bits; } value = {x};
    return value.bits;
}

int __fpclassify(double x) {
    const unsigned long long exponent = bits_of(x) >> 52 & 0x7ff, fraction = bits_of(x) << 12;
    if (exponent == 0x7ff) return fraction ? FP_NAN : FP_INFINITE;
    if (exponent == 0) return fraction ? FP_SUBNORMAL : FP_ZERO;
    return FP_NORMAL;
}

int __isnan(double x) { return __fpclassify(x) == FP_NAN; }

int __signbit(double x) { return (int)(bits_of(x) >> 63); }
