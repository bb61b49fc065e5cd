// SPDX-License-Identifier: GPL-3.0-or-later
// Parts of a compiler's runtime that a DLL needs. The compiler's own are not linked: they bring
// another cos and memcpy than ucrtbase.dll, so results would differ from those of other builds.

#if defined(_WIN32)

int __stdcall DllMainCRTStartup(void *a, unsigned b, void *c) {
  (void)a, (void)b, (void)c;
  return 1;
}

// Called where a function's arrays pass a page: touches each page, so that Windows grows the stack.
#if defined(__x86_64__)
__asm__(".globl ___chkstk_ms\n___chkstk_ms:\n"
        "push %rcx\n push %rax\n lea 24(%rsp), %rcx\n"
        "1: cmp $4096, %rax\n jbe 2f\n sub $4096, %rcx\n orq $0, (%rcx)\n"
        "sub $4096, %rax\n jmp 1b\n"
        "2: sub %rax, %rcx\n orq $0, (%rcx)\n pop %rax\n pop %rcx\n ret\n");
#else
__asm__(".globl __chkstk\n__chkstk:\n"
        "lsl x16, x15, #4\n mov x17, sp\n"
        "1: sub x17, x17, #4096\n subs x16, x16, #4096\n ldr xzr, [x17]\n b.gt 1b\n ret\n");
#endif

#endif
