#include "refusing.h"

#include <errno.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <stddef.h>
#include <sys/prctl.h>
#include <sys/syscall.h>

#define LOAD(field)                                                                                \
    BPF_STMT(BPF_LD | BPF_W | BPF_ABS, (guint32)offsetof(struct seccomp_data, field))
#define UNLESS(number, skip) BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, (number), 0, (skip))
#define RETURN(what)         BPF_STMT(BPF_RET | BPF_K, (what))
#define FAIL(number)         RETURN(SECCOMP_RET_ERRNO | (number))

void refusing_begin(gboolean links) {
    struct sock_filter rules[] = {
        LOAD(nr),
        UNLESS(SYS_renameat2, 4),
        LOAD(args[4]), /* the flags of renameat2() */
        UNLESS(0, 1),
        RETURN(SECCOMP_RET_ALLOW),
        FAIL(EINVAL),
        UNLESS(SYS_fallocate, 1),
        FAIL(EOPNOTSUPP),
        UNLESS(links ? G_MAXUINT32 : SYS_linkat, 1),
        FAIL(EPERM),
#ifdef SYS_link
        UNLESS(links ? G_MAXUINT32 : SYS_link, 1),
        FAIL(EPERM),
#endif
        RETURN(SECCOMP_RET_ALLOW),
    };
    const struct sock_fprog program = {G_N_ELEMENTS(rules), rules};
    if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0 ||
        prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) != 0)
        g_error("seccomp: %s", g_strerror(errno));
}
