/* For a call that must fail, followed by others that use the same error. */
#pragma once

#include <glib.h>

/* Checks domain and code of *error, and frees it. */
#define assert_error_clear(error, domain, code)                                                    \
    do {                                                                                           \
        g_assert_error(*(error), domain, code);                                                    \
        g_clear_error(error);                                                                      \
    } while (0)
