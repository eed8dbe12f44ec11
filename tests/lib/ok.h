/*
 * A call that must not fail:
 *
 *     g_autoptr(ExrFile) file = ok(exr_read(path, ERR));
 *
 * ok() returns the value of the call. If an error was set, the test fails with its message. A test
 * of a failure uses a separate GError.
 */
#pragma once

#include <glib.h>

/* The error argument of a call inside ok(). */
#define ERR (&ok_call.error)

#define ok(call)                                                                                   \
    ({                                                                                             \
        __attribute__((cleanup(ok_end))) struct ok_call ok_call = {NULL, __FILE__, G_STRFUNC,      \
                                                                   #call, __LINE__};               \
        call;                                                                                      \
    })

struct ok_call {
    GError *error;
    const char *file, *function, *text;
    int line;
};

static inline void ok_end(struct ok_call *call) {
    if (call->error)
        g_assertion_message_error(G_LOG_DOMAIN, call->file, call->line, call->function, call->text,
                                  call->error, 0, 0);
}
