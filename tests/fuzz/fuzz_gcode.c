/* Lines of boards that speak G-code, in all languages. */
#include "fuzz.h"
#include "serial/answer.h"

#include <math.h>
#include <string.h>

static void check_values(const double *values, const gboolean *has, int n) {
    for (int i = 0; i < n; i++)
        g_assert_true(!(has && !has[i]) ? isfinite(values[i]) && fabs(values[i]) <= 1e9
                                        : values[i] == 0);
}

static void check_report(const struct gcode_report *report) {
    g_assert_cmpint(report->n_at, >, 0);
    g_assert_cmpint(report->n_at, <=, GCODE_MAX_AXES);
    g_assert_true(report->n_wco == 0 || report->n_wco == report->n_at);
    g_assert_cmpint(report->sub, >=, -1);
    check_values(report->at, NULL, report->n_at);
    check_values(report->wco, NULL, report->n_wco);
    for (const char *at = report->name; *at; at++)
        g_assert_true(g_ascii_isalpha(*at));
    gcode_report_stands(report);
}

static void check(const struct gcode_answer *answer) {
    g_assert_cmpint(answer->number, >=, 0);
    for (const char *at = answer->text; *at; at++)
        g_assert_true(g_ascii_isprint(*at));
    if (answer->kind == GCODE_REPORT)
        check_report(&answer->report);
    if (answer->kind == GCODE_POSITION || answer->kind == GCODE_SCALE) {
        check_values(answer->at, answer->has_at, GCODE_MAX_AXES);
        check_values(answer->steps, answer->has_steps, GCODE_MAX_AXES);
    }
    if (answer->kind == GCODE_SETTING || answer->kind == GCODE_LIMIT)
        check_values(&answer->value, NULL, 1);
    gcode_alarm_text(answer->number);
    gcode_error_text(answer->number);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    g_autofree char *text = fuzz_text(data, size);
    g_auto(GStrv) lines = g_strsplit_set(text, "\r\n", -1);
    for (char **line = lines; *line; line++) {
        struct gcode_answer answer;
        gcode_grbl_read(*line, &answer);
        check(&answer);
        /* A report that is cut off anywhere is none. */
        const gsize n = strlen(*line);
        if (answer.kind == GCODE_REPORT) {
            (*line)[n - 1] = 0;
            gcode_grbl_read(*line, &answer);
            g_assert_cmpint(answer.kind, ==, GCODE_NONE);
        }
        gcode_marlin_read(*line, &answer);
        check(&answer);
        gcode_klipper_read(*line, &answer);
        check(&answer);
    }
    return 0;
}
