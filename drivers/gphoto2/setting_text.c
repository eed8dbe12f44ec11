#include "setting_text.h"

#include <math.h>
#include <string.h>

double setting_text_number(const char *text) {
    static const char *const units[] = {"", "s", "sec", "\"", "%", "ms", "mm"};
    char *end;
    while (g_ascii_isspace(*text))
        text++;
    if (g_ascii_strncasecmp(text, "f/", 2) == 0)
        text += 2;
    else if (g_ascii_strncasecmp(text, "iso", 3) == 0)
        text += 3;
    while (g_ascii_isspace(*text))
        text++;
    if (!g_ascii_isdigit(*text) && *text != '.')
        return -1;
    double number = g_ascii_strtod(text, &end);
    if (*end == '/' && g_ascii_isdigit(end[1])) {
        const double divisor = g_ascii_strtod(end + 1, &end);
        if (divisor <= 0)
            return -1;
        number /= divisor;
    }
    while (g_ascii_isspace(*end))
        end++;
    for (gsize i = 0; i < G_N_ELEMENTS(units); i++)
        if (g_ascii_strcasecmp(end, units[i]) == 0)
            return strcmp(units[i], "ms") == 0 ? number / 1000 : number;
    return -1;
}

gboolean setting_text_equal(const char *a, const char *b) {
    const double x = setting_text_number(a), y = setting_text_number(b);
    if (x >= 0 && y >= 0)
        return fabs(x - y) <= 1e-6 * MAX(x, y);
    return g_ascii_strcasecmp(a, b) == 0;
}

int setting_text_nearest(const char *value, const char *const *texts) {
    const double wanted = setting_text_number(value);
    int nearest = -1;
    double least = INFINITY;
    for (int i = 0; wanted > 0 && texts[i]; i++) {
        const double number = setting_text_number(texts[i]);
        const double distance = number > 0 ? fabs(log(number / wanted)) : INFINITY;
        if (distance < least) {
            least = distance;
            nearest = i;
        }
    }
    return nearest;
}
