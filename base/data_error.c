#include "data_error.h"

G_DEFINE_QUARK(mesorig - data - error - quark, data_error)

void data_error_set(const char *file, int line, GError **error, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    g_autofree char *message = g_strdup_vprintf(format, arguments);
    va_end(arguments);
    if (line > 0)
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID, "%s:%d: %s", file, line, message);
    else
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID, "%s: %s", file, message);
}
