/*
 * Preloaded into User Mode Linux 6.1 on processors with AMX.
 *
 * That kernel keeps 2696 bytes of a process's extended registers and hands those back to the host, which takes only
 * the whole area (11008 bytes with AMX) and answers EFAULT: the guest dies before its first program. Here the part
 * is laid over the area as the host has it. Guests cannot ask for AMX, so what lies behind the part stays unused.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <elf.h>
#include <stdarg.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/uio.h>

typedef long (*ptrace_call)(enum __ptrace_request, int, void *, void *);

long ptrace(enum __ptrace_request request, ...)
{
    static char area[65536];
    static ptrace_call host_ptrace;
    va_list arguments;

    va_start(arguments, request);
    int pid = va_arg(arguments, int);
    void *address = va_arg(arguments, void *);
    void *data = va_arg(arguments, void *);
    va_end(arguments);

    if (!host_ptrace)
        host_ptrace = (ptrace_call)dlsym(RTLD_NEXT, "ptrace");
    if (request != PTRACE_SETREGSET || (long)address != NT_X86_XSTATE)
        return host_ptrace(request, pid, address, data);

    struct iovec *part = data;
    struct iovec whole = {area, sizeof area};
    if (host_ptrace(PTRACE_GETREGSET, pid, address, &whole) < 0)
        return -1;
    memcpy(area, part->iov_base, part->iov_len);
    return host_ptrace(PTRACE_SETREGSET, pid, address, &whole);
}
