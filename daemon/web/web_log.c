#include "web_log.h"

void web_log(const char *format, ...) {
    static gint64 begun_us;
    static int lines, left_out;
    const gint64 now_us = g_get_monotonic_time();
    if (begun_us == 0 || now_us - begun_us > 60 * G_USEC_PER_SEC) {
        if (left_out)
            g_printerr("mesorig-web: %d further lines of this kind were left out\n", left_out);
        begun_us = now_us;
        lines = left_out = 0;
    }
    if (++lines > WEB_LOG_LINES) {
        left_out++;
        return;
    }
    va_list arguments;
    va_start(arguments, format);
    g_autofree char *text = g_strdup_vprintf(format, arguments);
    va_end(arguments);
    g_printerr("mesorig-web: %s\n", text);
}
