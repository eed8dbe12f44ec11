/* Lines that boards send. Reports are made from values, with their fields in any order. */
#include "lib/test.h"
#include "serial/answer.h"

#include <math.h>
#include <string.h>

static const char *const states[] = {"Idle", "Run",   "Hold", "Jog",  "Alarm",
                                     "Door", "Check", "Home", "Sleep"};

/* A value as a board writes it. */
static double any_value(GRand *random) {
    return (double)g_rand_int_range(random, -9999999, 9999999) / 1000;
}

static char *numbers(const double *values, int n, const char *key) {
    GString *text = g_string_new(key);
    for (int i = 0; i < n; i++)
        g_string_append_printf(text, "%s%.3f", i ? "," : "", values[i]);
    return g_string_free(text, FALSE);
}

static void shuffle(GRand *random, char **fields, int n) {
    for (int i = n - 1; i > 0; i--) {
        const int k = g_rand_int_range(random, 0, i + 1);
        char *field = fields[i];
        fields[i] = fields[k];
        fields[k] = field;
    }
}

/* Each report reads back as it was made, whatever the order of its fields. Without one of its
 * bytes it is no report, or differs only where that cannot show: in a digit before the point, in
 * a sign, or in a field that is not used. */
TEST(report) {
    g_autoptr(GRand) random = g_rand_new_with_seed(1);
    int n_unnoticed = 0, n_cut = 0;
    for (int round = 0; round < 2000; round++) {
        const int n = g_rand_int_range(random, 3, GCODE_MAX_AXES + 1);
        const int state = g_rand_int_range(random, 0, (int)G_N_ELEMENTS(states));
        const int sub =
            state == GCODE_HOLD || state == GCODE_DOOR ? g_rand_int_range(random, 0, 4) : -1;
        const gboolean work = g_rand_boolean(random), offset = g_rand_boolean(random);
        double at[GCODE_MAX_AXES], wco[GCODE_MAX_AXES];
        for (int i = 0; i < n; i++) {
            at[i] = any_value(random);
            wco[i] = any_value(random);
        }
        char *fields[6];
        int n_fields = 0;
        fields[n_fields++] = numbers(at, n, work ? "WPos:" : "MPos:");
        fields[n_fields++] = g_strdup("FS:500,0");
        fields[n_fields++] = g_strdup("Ov:100,100,100");
        fields[n_fields++] = g_strdup("Pn:XZ");
        if (offset)
            fields[n_fields++] = numbers(wco, n, "WCO:");
        shuffle(random, fields, n_fields);
        g_autoptr(GString) line = g_string_new("<");
        g_string_append(line, states[state]);
        if (sub >= 0)
            g_string_append_printf(line, ":%d", sub);
        for (int i = 0; i < n_fields; i++) {
            g_string_append_printf(line, "|%s", fields[i]);
            g_free(fields[i]);
        }
        g_string_append_c(line, '>');

        struct gcode_answer answer;
        gcode_grbl_read(line->str, &answer);
        g_assert_cmpint(answer.kind, ==, GCODE_REPORT);
        const struct gcode_report *report = &answer.report;
        g_assert_cmpint((int)report->state, ==, state);
        g_assert_cmpint(report->sub, ==, sub);
        g_assert_cmpint(report->is_work, ==, work);
        g_assert_cmpint(report->n_at, ==, n);
        g_assert_cmpint(report->n_wco, ==, offset ? n : 0);
        g_assert_cmpstr(report->inputs, ==, "XZ");
        for (int i = 0; i < n; i++) {
            g_assert_cmpfloat(fabs(report->at[i] - at[i]), <, 1e-9);
            g_assert_true(!offset || fabs(report->wco[i] - wco[i]) < 1e-9);
        }

        g_string_erase(line, g_rand_int_range(random, 0, (gint32)line->len), 1);
        n_cut++;
        gcode_grbl_read(line->str, &answer);
        n_unnoticed += answer.kind == GCODE_REPORT;
    }
    g_test_message("%d of %d reports without one of their bytes were taken", n_unnoticed, n_cut);
    g_assert_cmpint(n_unnoticed, <, n_cut * 3 / 4);
    g_assert_cmpint(n_unnoticed, >, 0);
}

TEST(stands) {
    static const struct {
        const char *state;
        gboolean stands;
    } cases[] = {{"Idle", TRUE},    {"Run", FALSE},    {"Hold:0", TRUE}, {"Hold:1", FALSE},
                 {"Jog", FALSE},    {"Alarm", TRUE},   {"Door:0", TRUE}, {"Door:1", TRUE},
                 {"Door:2", FALSE}, {"Door:3", FALSE}, {"Check", TRUE},  {"Home", FALSE},
                 {"Sleep", TRUE},   {"Tool", FALSE},   {"Hold", FALSE}};
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        g_autofree char *line = g_strdup_printf("<%s|MPos:1.000,2.000,3.000>", cases[i].state);
        struct gcode_answer answer;
        gcode_grbl_read(line, &answer);
        g_assert_cmpint(answer.kind, ==, GCODE_REPORT);
        g_assert_cmpint(gcode_report_stands(&answer.report), ==, cases[i].stands);
    }
}

TEST(grbl) {
    static const struct {
        const char *line;
        enum gcode_kind kind;
        int number;
    } cases[] = {
        {"ok", GCODE_OK, 0},
        {"okk", GCODE_NONE, 0},
        {"error:22", GCODE_ERROR, 22},
        {"error:", GCODE_NONE, 0},
        {"error:2x", GCODE_NONE, 0},
        {"ALARM:9", GCODE_ALARM_NOW, 9},
        {"Grbl 1.1h ['$' for help]", GCODE_BANNER, 0},
        {"GrblHAL 1.1f ['$' or '$HELP' for help]", GCODE_BANNER, 0},
        {"Grbl 3.7 [FluidNC v3.7.8 (wifi) '$' for help]", GCODE_BANNER, 0},
        {"[MSG:Grbl]", GCODE_NONE, 0},
        {"$120=10.000", GCODE_SETTING, 120},
        {"$120=10.000 (x accel, mm/sec^2)", GCODE_SETTING, 120},
        {"$N0=G54", GCODE_NONE, 0},
        {"[VER:1.1h.20190825:]", GCODE_VERSION, 0},
        {"<Idle>", GCODE_NONE, 0},
        {"<Run|MPos:1.000,1.000,1.000|FS:0,<Idle|MPos:2.000,2.000,2.000>", GCODE_NONE, 0},
        {"<Idle|FS:0,0>", GCODE_NONE, 0},
        {"<Idle|MPos:0.000,0.00,0.000>", GCODE_NONE, 0},
        {"<Idle|MPos:0.000,0.000,nan>", GCODE_NONE, 0},
        {"<Idle|MPos:0.000,0.000,0x10>", GCODE_NONE, 0},
        {"<Idle|MPos:1.0,1.0,1.0,1.0,1.0,1.0,1.0>", GCODE_NONE, 0},
        {"<Idle|MPos:99999999999.0,1.0,1.0>", GCODE_NONE, 0},
        {"", GCODE_NONE, 0},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        struct gcode_answer answer;
        gcode_grbl_read(cases[i].line, &answer);
        if (answer.kind != cases[i].kind || answer.number != cases[i].number)
            g_error("\"%s\" is %d with %d", cases[i].line, (int)answer.kind, answer.number);
    }
}

TEST(klipper) {
    struct gcode_answer answer;
    gcode_klipper_read("X:10.000 Y:-2.500 Z:0.000 E:7.000", &answer);
    g_assert_cmpint(answer.kind, ==, GCODE_POSITION);
    g_assert_true(answer.has_at[1] && !answer.has_at[3] && !answer.has_steps[0]);
    g_assert_cmpfloat(answer.at[1], ==, -2.5);
    gcode_klipper_read("// max_accel: 3000.000000", &answer);
    g_assert_cmpint(answer.kind, ==, GCODE_LIMIT);
    g_assert_cmpfloat(answer.value, ==, 3000);
    gcode_klipper_read("ok FIRMWARE_NAME:Klipper FIRMWARE_VERSION:v0.13.0-300-gabc", &answer);
    g_assert_cmpint(answer.kind, ==, GCODE_OK);
    g_assert_cmpstr(answer.text, ==, "Klipper v0.13.0-300-gabc");
    gcode_klipper_read("ok FIRMWARE_VERSION:v0.9 FIRMWARE_NAME:Klipper", &answer);
    g_assert_cmpstr(answer.text, ==, "Klipper v0.9");
    gcode_klipper_read("!! Move out of range: 1.000", &answer);
    g_assert_cmpint(answer.kind, ==, GCODE_FAILURE);
    g_assert_cmpstr(answer.text, ==, "Move out of range: 1.000");
    gcode_klipper_read("// Unknown command:\"M410\"", &answer);
    g_assert_cmpint(answer.kind, ==, GCODE_UNKNOWN);
    g_assert_cmpstr(answer.text, ==, "\"M410\"");
    static const struct {
        const char *line;
        enum gcode_kind kind;
        int number;
    } cases[] = {
        {"ok", GCODE_OK, 0},
        {"ok T:0", GCODE_OK, 0},
        {"okk", GCODE_NONE, 0},
        {"// ECHO MESORIG=17", GCODE_ECHO, 17},
        {"// ECHO MESORIG=17x", GCODE_NONE, 0},
        {"// ECHO MESORIG=", GCODE_NONE, 0},
        {"// max_velocity: 300.000000", GCODE_LIMIT, 203},
        {"// max_velocity: 300.0 mm", GCODE_NONE, 0},
        {"// max_accel_to_decel: 1500.000000", GCODE_NONE, 0},
        {"// Klipper state: Ready", GCODE_STATE, KLIPPER_READY},
        {"// Klipper state: Shutdown", GCODE_STATE, KLIPPER_SHUTDOWN},
        {"// Klipper state: Disconnect", GCODE_STATE, KLIPPER_LEAVES},
        {"// Klipper state: Not ready", GCODE_NONE, 0},
        {"// Printer is not ready", GCODE_STATE, KLIPPER_STARTING},
        {"// Printer is shutdown", GCODE_STATE, KLIPPER_SHUTDOWN},
        {"// Printer is halted", GCODE_STATE, KLIPPER_HALTED},
        {"X:1.000 Y:2.000", GCODE_NONE, 0},
        {"X:1.00 Y:2.000 Z:3.000 E:0.000", GCODE_NONE, 0},
        {"X:1.000 Y:2.000 Z:3.000 E:0.0000", GCODE_NONE, 0},
        {"X:1.000 Y:2.000 Z:3.000 E:0.000 Count X:1", GCODE_NONE, 0},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        gcode_klipper_read(cases[i].line, &answer);
        if (answer.kind != cases[i].kind || answer.number != cases[i].number)
            g_error("\"%s\" is %d with %d", cases[i].line, (int)answer.kind, answer.number);
    }
}

TEST(marlin) {
    struct gcode_answer answer;
    gcode_marlin_read("X:10.00 Y:-2.50 Z:0.00 E:7.00 Count X:800 Y:-200 Z:0", &answer);
    g_assert_cmpint(answer.kind, ==, GCODE_POSITION);
    g_assert_true(answer.has_at[1] && answer.has_steps[1] && !answer.has_at[3]);
    g_assert_cmpfloat(answer.at[1], ==, -2.5);
    g_assert_cmpfloat(answer.steps[0], ==, 800);
    gcode_marlin_read("echo:  M203 X500.00 Y400.00 Z5.00 E25.00", &answer);
    g_assert_cmpint(answer.kind, ==, GCODE_SCALE);
    g_assert_cmpint(answer.number, ==, 203);
    g_assert_cmpfloat(answer.at[1], ==, 400);
    gcode_marlin_read("FIRMWARE_NAME:Marlin bugfix-2.1.x SOURCE_CODE_URL:x", &answer);
    g_assert_cmpint(answer.kind, ==, GCODE_VERSION);
    g_assert_cmpstr(answer.text, ==, "Marlin bugfix-2.1.x");
    static const struct {
        const char *line;
        enum gcode_kind kind;
        int number;
    } cases[] = {
        {"ok", GCODE_OK, 0},
        {"ok N5 P15 B3", GCODE_OK, 0},
        {"start", GCODE_BANNER, 0},
        {"echo:busy: processing", GCODE_BUSY, 0},
        {"Resend: 12", GCODE_RESEND, 12},
        {"rs N12", GCODE_RESEND, 12},
        {"Resend: ", GCODE_NONE, 0},
        {"Error:checksum mismatch, Last Line: 3", GCODE_FAILURE, 0},
        {"Error:Printer halted. kill() called!", GCODE_KILLED, 0},
        {"echo:Unknown command: \"L7\"", GCODE_UNKNOWN, 7},
        {"echo:Unknown command: \"L7x\"", GCODE_NONE, 0},
        {"X:1.00 Y:2.00", GCODE_NONE, 0},
        {"X:1.00 Y:2.00 Count X:", GCODE_NONE, 0},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        gcode_marlin_read(cases[i].line, &answer);
        if (answer.kind != cases[i].kind || answer.number != cases[i].number)
            g_error("\"%s\" is %d with %d", cases[i].line, (int)answer.kind, answer.number);
    }
}
