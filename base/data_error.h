/* This error domain is for errors in the content of a data file, a table or a session. The code of
 * every folder may use it. */
#pragma once

#include <glib.h>

#define DATA_ERROR data_error_quark()
GQuark data_error_quark(void);
enum data_error {
    /* The data does not fit its session or format (size, NaN, checksum, syntax), an option does not
     * fit the data, or a computation with the data fails. */
    DATA_ERROR_INVALID,
    DATA_ERROR_INCOMPLETE, /* frames or products are missing */
    DATA_ERROR_EXISTS,     /* the file or session to be made already exists */
    DATA_ERROR_IO,         /* the system could not read or write a file */
};

/* Sets the error DATA_ERROR_INVALID with the text "FILE:LINE: …". Lines are counted from 1. If line
 * is 0, the text is "FILE: …". */
void data_error_set(const char *file, int line, GError **error, const char *format, ...)
    G_GNUC_PRINTF(4, 5);
/* The same as data_error_set(), as an expression with the value FALSE. */
#define data_error_fail(...) (data_error_set(__VA_ARGS__), FALSE)
