/* ptrace that writes extended registers whole, for a program that holds the front of them: a kernel of user-mode Linux
 * keeps 2696 bytes, a processor with AMX has 11008, and a host takes all of them or none (EFAULT). To be preloaded. */
#include <elf.h>
#include <stdarg.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

enum { XSTATE_MOST = 65536 };

/* Copies what the program holds over the front of what the process has. Returns -1 where that cannot be read. */
static long set_xstate(pid_t process, const struct iovec *front) {
    static char all[XSTATE_MOST];
    struct iovec whole = {all, sizeof all};
    if (syscall(SYS_ptrace, PTRACE_GETREGSET, process, NT_X86_XSTATE, &whole) < 0)
        return -1;
    memcpy(all, front->iov_base, front->iov_len < whole.iov_len ? front->iov_len : whole.iov_len);
    return syscall(SYS_ptrace, PTRACE_SETREGSET, process, NT_X86_XSTATE, &whole);
}

long ptrace(enum __ptrace_request request, ...) {
    va_list rest;
    va_start(rest, request);
    const pid_t process = va_arg(rest, pid_t);
    void *const address = va_arg(rest, void *);
    void *const data = va_arg(rest, void *);
    va_end(rest);
    if (request == PTRACE_SETREGSET && address == (void *)NT_X86_XSTATE)
        return set_xstate(process, data);
    /* A request that reads a word returns it through a pointer, where glibc's ptrace returns it as the result. */
    long word = 0;
    const int reads = request >= PTRACE_PEEKTEXT && request <= PTRACE_PEEKUSER;
    const long result = syscall(SYS_ptrace, request, process, address, reads ? (void *)&word : data);
    return reads && result >= 0 ? word : result;
}
