#include "answer.h"

#include "base/error_details.h"

#include <math.h>
#include <string.h>

#define MAX_VALUE  1e9 /* no position or setting of a board is larger */
#define MAX_DIGITS 31

/* Parses a decimal number without exponent and moves *at behind it. Returns FALSE if there is
 * none. *ret_decimals is the number of digits after the point. */
static gboolean take_number(const char **at, double *ret, int *ret_decimals) {
    char text[MAX_DIGITS + 1];
    const gsize n = strspn(*at, "+-.0123456789");
    char *end = NULL;
    if (n == 0 || n > MAX_DIGITS)
        return FALSE;
    memcpy(text, *at, n);
    text[n] = 0;
    *ret = g_ascii_strtod(text, &end);
    const char *point = strchr(text, '.');
    *ret_decimals = point ? (int)(n - 1 - (gsize)(point - text)) : 0;
    *at += n;
    return end == text + n && end != text && fabs(*ret) <= MAX_VALUE;
}

/* Parses a natural number that is the whole text. */
static gboolean read_integer(const char *text, int *ret) {
    int value = 0;
    if (!*text)
        return FALSE;
    for (; *text; text++) {
        if (!g_ascii_isdigit(*text) || value > 99999)
            return FALSE;
        value = 10 * value + (*text - '0');
    }
    *ret = value;
    return TRUE;
}

/* Parses numbers that are separated by commas. A board writes all of them with the same number of
 * decimals, so a lost digit is usually noticed. Returns their number, or 0 if the text is
 * damaged. */
static int read_numbers(const char *text, double *ret) {
    int first = 0;
    for (int n = 0; n < GCODE_MAX_AXES; n++, text++) {
        int decimals;
        if (!take_number(&text, &ret[n], &decimals) || (n > 0 && decimals != first))
            return 0;
        first = decimals;
        if (!*text)
            return n + 1;
        if (*text != ',')
            return 0;
    }
    return 0;
}

static gboolean read_state(const char *text, struct gcode_report *ret) {
    static const char *const names[] = {"Idle", "Run",   "Hold", "Jog",  "Alarm",
                                        "Door", "Check", "Home", "Sleep"};
    const char *colon = strchr(text, ':');
    const gsize n = colon ? (gsize)(colon - text) : strlen(text);
    ret->sub = -1;
    if (n == 0 || n >= sizeof ret->name || (colon && !read_integer(colon + 1, &ret->sub)))
        return FALSE;
    for (gsize i = 0; i < n; i++)
        if (!g_ascii_isalpha(text[i]))
            return FALSE;
    memcpy(ret->name, text, n);
    ret->state = GCODE_OTHER;
    for (guint i = 0; i < G_N_ELEMENTS(names); i++)
        if (strcmp(ret->name, names[i]) == 0)
            ret->state = (enum gcode_state)i;
    return TRUE;
}

/* Parses a field of a report. Returns FALSE if it is damaged. Unknown fields are ignored. */
static gboolean read_field(const char *field, struct gcode_report *ret) {
    const gboolean machine = g_str_has_prefix(field, "MPos:");
    if (machine || g_str_has_prefix(field, "WPos:")) {
        ret->is_work = !machine;
        ret->n_at = read_numbers(field + 5, ret->at);
        return ret->n_at > 0;
    }
    if (g_str_has_prefix(field, "WCO:")) {
        ret->n_wco = read_numbers(field + 4, ret->wco);
        return ret->n_wco > 0;
    }
    if (g_str_has_prefix(field, "Pn:")) {
        for (const char *at = field + 3; *at; at++)
            if (!g_ascii_isalpha(*at))
                return FALSE;
        g_strlcpy(ret->inputs, field + 3, sizeof ret->inputs);
    }
    return TRUE;
}

static gboolean read_report(const char *line, struct gcode_report *ret) {
    const gsize n = strlen(line);
    if (n < 2 || line[0] != '<' || strpbrk(line + 1, "<>") != line + n - 1)
        return FALSE;
    g_autofree char *inside = g_strndup(line + 1, n - 2);
    g_auto(GStrv) fields = g_strsplit(inside, "|", -1);
    if (!fields[0] || !read_state(fields[0], ret))
        return FALSE;
    for (char **field = fields + 1; *field; field++)
        if (!read_field(*field, ret))
            return FALSE;
    return ret->n_at > 0 && (ret->n_wco == 0 || ret->n_at == ret->n_wco);
}

gboolean gcode_report_stands(const struct gcode_report *report) {
    switch (report->state) {
    case GCODE_IDLE:
    case GCODE_ALARM:
    case GCODE_CHECK:
    case GCODE_SLEEP:
        return TRUE;
    case GCODE_HOLD:
        return report->sub == 0;
    case GCODE_DOOR:
        return report->sub == 0 || report->sub == 1;
    default:
        return FALSE;
    }
}

static void copy_text(const char *from, struct gcode_answer *to) {
    g_strlcpy(to->text, from, sizeof to->text);
    for (char *at = to->text; *at; at++)
        *at = g_ascii_isprint(*at) ? *at : '?';
}

/* Parses "$NUMBER=VALUE", which a comment in brackets may follow. */
static gboolean read_setting(const char *line, struct gcode_answer *ret) {
    const char *equals = strchr(line, '=');
    int decimals;
    if (!equals || equals - line < 2 || equals - line > 6)
        return FALSE;
    g_autofree char *key = g_strndup(line + 1, (gsize)(equals - line - 1));
    equals++;
    return read_integer(key, &ret->number) && take_number(&equals, &ret->value, &decimals) &&
           (*equals == 0 || *equals == ' ');
}

void gcode_grbl_read(const char *line, struct gcode_answer *ret) {
    *ret = (struct gcode_answer){.kind = GCODE_NONE};
    if (strcmp(line, "ok") == 0)
        ret->kind = GCODE_OK;
    else if (*line == '<' && read_report(line, &ret->report))
        ret->kind = GCODE_REPORT;
    else if (g_str_has_prefix(line, "error:") && read_integer(line + 6, &ret->number))
        ret->kind = GCODE_ERROR;
    else if (g_str_has_prefix(line, "ALARM:") && read_integer(line + 6, &ret->number))
        ret->kind = GCODE_ALARM_NOW;
    else if (g_ascii_strncasecmp(line, "Grbl", 4) == 0 && strchr(line, '['))
        ret->kind = GCODE_BANNER;
    else if (*line == '$' && read_setting(line, ret))
        ret->kind = GCODE_SETTING;
    else if (g_str_has_prefix(line, "[VER:"))
        ret->kind = GCODE_VERSION;
    if (ret->kind == GCODE_VERSION) {
        copy_text(line + 5, ret);
        g_strdelimit(ret->text, ":]", 0);
    }
}

/* Parses "X:1.00 Y:2.00 …" up to the end or to "Count". Returns the place where the parsing
 * stopped, or NULL if a number is damaged. */
static const char *read_places(const char *at, const char *between, gboolean *ret_has,
                               double *ret_values) {
    static const char letters[] = GCODE_LETTERS "E";
    for (;;) {
        const char *letter;
        int decimals;
        double value;
        while (*at == ' ')
            at++;
        letter = *at ? strchr(letters, *at) : NULL;
        if (!letter || !g_str_has_prefix(at + 1, between))
            return at;
        at += 1 + strlen(between);
        while (*at == ' ')
            at++;
        if (!take_number(&at, &value, &decimals))
            return NULL;
        if (*letter == 'E')
            continue;
        ret_has[letter - letters] = TRUE;
        ret_values[letter - letters] = value;
    }
}

/* Parses Marlin's answer to M114: "X:0.00 Y:0.00 Z:0.00 E:0.00 Count X:0 Y:0 Z:0". */
static gboolean read_position(const char *line, struct gcode_answer *ret) {
    const char *at = read_places(line, ":", ret->has_at, ret->at);
    if (!at || !g_str_has_prefix(at, "Count "))
        return FALSE;
    at = read_places(at + 6, ":", ret->has_steps, ret->steps);
    return at && *at == 0;
}

static gboolean read_scale(const char *line, struct gcode_answer *ret) {
    static const int numbers[] = {92, 201, 203};
    const char *code = strchr(line, 'M');
    for (gsize i = 0; code && i < G_N_ELEMENTS(numbers); i++) {
        g_autofree char *name = g_strdup_printf("M%d ", numbers[i]);
        if (!g_str_has_prefix(code, name))
            continue;
        const char *end = read_places(code + strlen(name), "", ret->has_at, ret->at);
        ret->number = numbers[i];
        return end && (*end == 0 || *end == ';');
    }
    return FALSE;
}

static gboolean read_resend(const char *line, struct gcode_answer *ret) {
    const char *number = NULL;
    if (g_str_has_prefix(line, "Resend:"))
        number = line + 7;
    else if (g_str_has_prefix(line, "rs "))
        number = line + 3;
    while (number && (*number == ' ' || *number == 'N'))
        number++;
    return number && read_integer(number, &ret->number);
}

/* Parses the line echo:Unknown command: "L42". */
static gboolean read_unknown(const char *line, struct gcode_answer *ret) {
    const char *quote = strstr(line, "nknown command: \"L");
    if (!quote)
        return FALSE;
    g_autofree char *number = g_strdup(strchr(quote, '"') + 2);
    char *end = strchr(number, '"');
    if (!end || end[1])
        return FALSE;
    *end = 0;
    return read_integer(number, &ret->number);
}

void gcode_marlin_read(const char *line, struct gcode_answer *ret) {
    *ret = (struct gcode_answer){.kind = GCODE_NONE};
    const char *version = g_str_has_prefix(line, "FIRMWARE_NAME:") ? line + 14 : NULL;
    if (strcmp(line, "ok") == 0 || g_str_has_prefix(line, "ok "))
        ret->kind = GCODE_OK;
    else if (strcmp(line, "start") == 0)
        ret->kind = GCODE_BANNER;
    else if (g_str_has_prefix(line, "echo:busy:") || g_str_has_prefix(line, "busy:"))
        ret->kind = GCODE_BUSY;
    else if (read_resend(line, ret))
        ret->kind = GCODE_RESEND;
    else if (g_str_has_prefix(line, "X:") && read_position(line, ret))
        ret->kind = GCODE_POSITION;
    else if (g_str_has_prefix(line, "Error:"))
        ret->kind = strstr(line, "halted") || strstr(line, "kill()") ? GCODE_KILLED : GCODE_FAILURE;
    else if (read_unknown(line, ret))
        ret->kind = GCODE_UNKNOWN;
    else if (read_scale(line, ret))
        ret->kind = GCODE_SCALE;
    else if (version)
        ret->kind = GCODE_VERSION;
    if (version) {
        while (*version == ' ')
            version++;
        copy_text(version, ret);
        char *end = strstr(ret->text, " SOURCE_CODE_URL");
        if (end)
            *end = 0;
    } else if (ret->kind == GCODE_FAILURE || ret->kind == GCODE_KILLED) {
        copy_text(line + 6, ret);
    }
}

/* Parses Klipper's answer to M114: "X:0.000 Y:0.000 Z:0.000 E:0.000". All numbers have three
 * decimals, so a lost digit is usually noticed. */
static gboolean read_places_only(const char *line, struct gcode_answer *ret) {
    const char *at = read_places(line, ":", ret->has_at, ret->at);
    if (!at || *at || !ret->has_at[2])
        return FALSE;
    for (const char *point = strchr(line, '.'); point; point = strchr(point + 1, '.'))
        if (strspn(point + 1, "0123456789") != 3)
            return FALSE;
    return TRUE;
}

/* Parses a line behind "// ". */
static enum gcode_kind read_info(const char *text, struct gcode_answer *ret) {
    static const struct {
        const char *text;
        enum klipper_state state;
    } states[] = {
        {"Klipper state: Ready", KLIPPER_READY},
        {"Klipper state: Shutdown", KLIPPER_SHUTDOWN},
        {"Klipper state: Disconnect", KLIPPER_LEAVES},
        {"Printer is not ready", KLIPPER_STARTING},
        {"Printer is shutdown", KLIPPER_SHUTDOWN},
        {"Printer is halted", KLIPPER_HALTED},
        {"Error configuring printer", KLIPPER_HALTED},
    };
    static const struct {
        const char *key;
        int number;
    } limits[] = {{"max_velocity: ", 203}, {"max_accel: ", 201}};
    for (gsize i = 0; i < G_N_ELEMENTS(states); i++) {
        if (strcmp(text, states[i].text) != 0)
            continue;
        ret->number = (int)states[i].state;
        return GCODE_STATE;
    }
    for (gsize i = 0; i < G_N_ELEMENTS(limits); i++) {
        const char *at = text + strlen(limits[i].key);
        int decimals;
        if (!g_str_has_prefix(text, limits[i].key) || !take_number(&at, &ret->value, &decimals) ||
            *at)
            continue;
        ret->number = limits[i].number;
        return GCODE_LIMIT;
    }
    if (g_str_has_prefix(text, "ECHO MESORIG=") && read_integer(text + 13, &ret->number))
        return GCODE_ECHO;
    if (g_str_has_prefix(text, "Unknown command:")) {
        copy_text(text + 16, ret);
        return GCODE_UNKNOWN;
    }
    return GCODE_NONE;
}

void gcode_klipper_read(const char *line, struct gcode_answer *ret) {
    *ret = (struct gcode_answer){.kind = GCODE_NONE};
    const char *version = strstr(line, "FIRMWARE_VERSION:");
    if (strcmp(line, "ok") == 0 || g_str_has_prefix(line, "ok ")) {
        ret->kind = GCODE_OK;
        if (version) {
            g_autofree char *text = g_strconcat("Klipper ", version + 17, NULL);
            *strchrnul(text + 8, ' ') = 0;
            copy_text(text, ret);
        }
    } else if (g_str_has_prefix(line, "X:") && read_places_only(line, ret)) {
        ret->kind = GCODE_POSITION;
    } else if (g_str_has_prefix(line, "!! ")) {
        ret->kind = GCODE_FAILURE;
        copy_text(line + 3, ret);
    } else if (g_str_has_prefix(line, "// ")) {
        ret->kind = read_info(line + 3, ret);
    }
}

const char *gcode_alarm_text(int number) {
    static const char *const texts[] = {
        [1] =
            "a limit switch stopped it" ERROR_ADVICE
            "move the axis off the switch, check min_deg, max_deg and units_per_deg, then home it",
        [2] = "the target is beyond the travel that is set in the board" ERROR_ADVICE
              "check min_deg and max_deg against $130 to $132 of the board, then home it",
        [3] = "the board was reset while it moved, so its position is lost" ERROR_ADVICE "home it",
        [6] = "the board was reset while it homed" ERROR_ADVICE "home it",
        [7] =
            "the safety door was opened while it homed" ERROR_ADVICE "close the door, then home it",
        [8] = "a limit switch stayed pressed after homing" ERROR_ADVICE
              "check the switch and its wiring, or raise $27 of the board, then home it",
        [9] = "homing did not find the limit switch" ERROR_ADVICE
              "check the switch, $23 (direction) and $130 to $132 (travel) of the board, then home "
              "it",
        [10] = "an emergency stop is active, or the two motors of an axis did not find their "
               "switches" ERROR_ADVICE "release the stop or check the switches, then home it",
    };
    return number > 0 && number < (int)G_N_ELEMENTS(texts) ? texts[number] : NULL;
}

const char *gcode_error_text(int number) {
    static const char *const texts[] = {
        [1] = "damaged line" ERROR_ADVICE "check the cable, then home it",
        [2] = "damaged number" ERROR_ADVICE "check the cable, then home it",
        [3] =
            "unknown command" ERROR_ADVICE "if it was a command to home one axis, set homing = all",
        [5] = "homing is off in the board" ERROR_ADVICE
              "set $22=1 in the board, or homing = here in the rig file",
        [7] = "the board could not read its settings and has set the defaults" ERROR_ADVICE
              "write your settings into the board again, then home it",
        [8] = "the board still moves" ERROR_ADVICE "wait until it stands, then home it",
        [9] = "the board is locked by an alarm" ERROR_ADVICE "home it",
        [13] = "the safety door is open" ERROR_ADVICE "close it, then home it",
        [15] = "the target is beyond the travel that is set in the board" ERROR_ADVICE
               "check min_deg and max_deg against $130 to $132 of the board",
        [20] = "unsupported command" ERROR_ADVICE "check that the firmware is GRBL 1.1 or later",
        [24] = "damaged line" ERROR_ADVICE "check the cable, then home it",
    };
    return number > 0 && number < (int)G_N_ELEMENTS(texts) ? texts[number] : NULL;
}
