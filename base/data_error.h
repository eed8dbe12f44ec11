/* Errors in what a file, table or session holds; every room that reads data uses this domain. */
#pragma once

#include <gio/gio.h>

#define DATA_ERROR data_error_quark()
GQuark data_error_quark(void);
enum data_error {
    DATA_ERROR_INVALID,    /* does not fit its session or format: size, NaN, checksum, syntax */
    DATA_ERROR_INCOMPLETE, /* frames or products are missing */
    DATA_ERROR_EXISTS,     /* the file or session to be made exists already */
    DATA_ERROR_IO,
};

/* DATA_ERROR_INVALID "FILE: …" or "FILE:LINE: …" (line from 1; 0: none). */
void data_error_set(const char *file, int line, GError **error, const char *format, ...)
    G_GNUC_PRINTF(4, 5);
/* The same as data_error_set(), as an expression with the value FALSE. */
#define data_error_fail(...) (data_error_set(__VA_ARGS__), FALSE)
