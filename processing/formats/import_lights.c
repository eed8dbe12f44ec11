/* Reads lists of the lights of one view, in the forms in which RTI data sets are published. */
#include "import_private.h"

#include <math.h>
#include <string.h>

#include "base/data_error.h"
#include "base/input_file.h"
#include "base/nearest.h"
#include "base/text_table.h"

#define MAX_LIGHTS     65536
#define MAX_EXPONENT   1000
#define MAX_LIST_BYTES (64 << 20)
/* minimum length of a direction in a list, which should be a unit vector */
#define MIN_LENGTH 0.5
/* a light is on the horizon if z of its unit vector is between −HORIZON and 0 */
#define HORIZON 0.02
/* maximum θ of a light in a table; from 90° on, the light is on the horizon */
#define HORIZON_DEG 91
/* largest share of the lights that may be on the horizon; one such light is always allowed */
#define MAX_ON_IT 0.1
#define DEG       (180 / G_PI)
#define EXPECTED  "a picture's name and x, y, z of the direction to its light"

/* Indices of the columns of a table, or −1 if there is no such column. most is the largest
 * index. */
struct columns {
    char separator[2];
    int name, x, y, z, theta, phi, exponent, most;
    gboolean radians;
    gboolean mm; /* whether x, y and z are a position in mm */
};

struct list {
    const char *path;
    GArray *lights; /* of struct import_light */
    struct columns columns;
    gboolean placed; /* whether the next light has a position and an exponent */
    double exponent;
    gint64 count; /* number of pictures that the list states; 0 if it states none */
    int count_line;
};

static void light_clear(gpointer data) {
    g_free(((struct import_light *)data)->name);
}

static gboolean number(const struct list *list, int line, const char *word, double *ret,
                       GError **error) {
    const char separator = *list->columns.separator;
    return text_table_parse(word, separator == ';' || separator == '\t', ret) ||
           data_error_fail(list->path, line, error, "“%s” is not a number; correct it in this line",
                           word);
}

static gboolean is_number(const char *word) {
    char *end;
    g_ascii_strtod(word, &end);
    return end > word && !*end;
}

/* Adds a light. Takes ownership of name. Fails if the direction d is too short or below the
 * horizon, if there are too many lights, or if only some lights have names. */
static gboolean add(struct list *list, int line, char *name, const double d[3], GError **error) {
    const double length = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    const struct import_light *first = (const struct import_light *)(gpointer)list->lights->data;
    const struct import_light light = {.name = g_strdup(name),
                                       .theta_deg = acos(CLAMP(d[2] / length, -1, 1)) * DEG,
                                       .phi_deg = atan2(d[1], d[0]) * DEG,
                                       .on_horizon = d[2] <= 0,
                                       .placed = list->placed,
                                       .position_mm = vec3(d[0], d[1], d[2]),
                                       .exponent = list->exponent,
                                       .line = line};
    const gboolean mixed = list->lights->len > 0 && (first->name == NULL) != (name == NULL);
    const gboolean named = name != NULL;
    g_free(name);
    g_array_append_val(list->lights, light);
    if (length < MIN_LENGTH)
        return data_error_fail(list->path, line, error,
                               list->placed
                                   ? "the lamp at %g, %g, %g mm is in the middle of the sample; "
                                     "give its position as x_mm, y_mm and z_mm"
                                   : "the direction %g %g %g is too short; give x, y, z of a "
                                     "vector of length 1",
                               d[0], d[1], d[2]);
    if (d[2] < -HORIZON * length)
        return data_error_fail(list->path, line, error,
                               "the direction %g %g %g to the light leads below the sample; z must "
                               "be above 0",
                               d[0], d[1], d[2]);
    if (list->lights->len > MAX_LIGHTS)
        return data_error_fail(list->path, line, error,
                               "the list has more than %d lights; leave out the others",
                               MAX_LIGHTS);
    return !mixed ||
           data_error_fail(list->path, line, error,
                           named ? "this line has a picture's name, but the first line has none; "
                                   "name all pictures, or none"
                                 : "x, y, z must follow a picture's name, as in the lines before");
}

/* Cuts the last three words off a text. Returns FALSE if the text has fewer words. Sets
 * *ret_nameless to TRUE if there is no text in front of the three words. */
static gboolean take_words(char *text, char *words[3], gboolean *ret_nameless) {
    int n = 0;
    while (n < 3 && *g_strchomp(text)) {
        char *blank = strrchr(text, ' ');
        words[2 - n++] = blank ? blank + 1 : text;
        if (!blank)
            break;
        *blank = '\0';
    }
    *ret_nameless = n == 3 && words[0] == text;
    return n == 3;
}

/* Parses "name x y z" or "x y z". The name may contain blanks. If the last three words, separated
 * by blanks, are numbers, their commas are decimal commas. Otherwise commas separate words. */
static gboolean parse_words(struct list *list, int line, const char *text, GError **error) {
    g_autofree char *copy = g_strdelimit(g_strdup(text), "\t;", ' ');
    char *words[3] = {NULL};
    double d[3];
    gboolean nameless = FALSE, good = take_words(copy, words, &nameless);
    for (int i = 0; good && i < 3; i++)
        good = text_table_parse(words[i], TRUE, &d[i]);
    if (!good) {
        g_free(copy);
        copy = g_strdelimit(g_strdup(text), "\t,;", ' ');
        if (!take_words(copy, words, &nameless) || (nameless && !is_number(words[0])))
            return data_error_fail(
                list->path, line, error, "“%s” cannot be read; this line must be %s" EXPECTED, text,
                list->lights->len == 0 && list->count == 0 ? "the number of pictures, or " : "");
        for (int i = 0; i < 3; i++)
            if (!number(list, line, words[i], &d[i], error))
                return FALSE;
    }
    /* The name is the text in front of the three words. Separators within the name stay as in the
     * file. */
    char *name = nameless ? NULL : g_strndup(text, strlen(g_strchomp(copy)));
    return add(list, line, name, d, error);
}

static gboolean parse_cells(struct list *list, int line, const char *text, GError **error) {
    const struct columns *c = &list->columns;
    g_auto(GStrv) cells = g_strsplit(text, c->separator, -1);
    double d[3];
    for (char **cell = cells; *cell; cell++)
        g_strstrip(g_strdelimit(*cell, "\"", ' '));
    if ((int)g_strv_length(cells) <= c->most)
        return data_error_fail(list->path, line, error,
                               "this line has %u columns, but the first line names at least %d; "
                               "add the missing values",
                               g_strv_length(cells), c->most + 1);
    if (c->theta < 0) {
        if (!number(list, line, cells[c->x], &d[0], error) ||
            !number(list, line, cells[c->y], &d[1], error) ||
            !number(list, line, cells[c->z], &d[2], error))
            return FALSE;
    } else {
        double theta, phi;
        if (!number(list, line, cells[c->theta], &theta, error) ||
            !number(list, line, cells[c->phi], &phi, error))
            return FALSE;
        const double unit = c->radians ? DEG : 1;
        if (!(theta >= 0 && theta * unit <= HORIZON_DEG))
            return data_error_fail(
                list->path, line, error,
                "theta is %g%s; it is the angle from the normal and must be from 0 to below %s",
                theta, c->radians ? "" : "°", c->radians ? "π/2" : "90°");
        theta *= unit / DEG;
        phi *= unit / DEG;
        d[0] = sin(theta) * cos(phi);
        d[1] = sin(theta) * sin(phi);
        d[2] = cos(theta);
    }
    list->placed = c->mm;
    if (c->exponent >= 0 && !number(list, line, cells[c->exponent], &list->exponent, error))
        return FALSE;
    if (!(list->exponent >= 0 && list->exponent <= MAX_EXPONENT))
        return data_error_fail(list->path, line, error,
                               "exponent is %g, but must be from 0 to %d: it is the n of cosⁿ, by "
                               "which the lamp's light falls with the angle from its aim",
                               list->exponent, MAX_EXPONENT);
    if (c->name >= 0 && !*cells[c->name])
        return data_error_fail(list->path, line, error,
                               "column %d is empty, but must have a picture's name", c->name + 1);
    return add(list, line, c->name >= 0 ? g_strdup(cells[c->name]) : NULL, d, error);
}

/* Finds a column whose name is not known but resembles a known name. Returns a sentence that
 * suggests the known name (g_free()), or NULL if there is no such column. */
static char *misspelt(const char *text, const struct columns *c) {
    static const char *const known[] = {"name",  "filename", "file",      "image",   "picture",
                                        "theta", "phi",      "theta_deg", "phi_deg", "x_mm",
                                        "y_mm",  "z_mm",     "exponent",  NULL};
    g_autofree char *lower = g_ascii_strdown(text, -1);
    g_auto(GStrv) cells = g_strsplit(g_strdelimit(lower, "\"", ' '), c->separator, -1);
    for (int i = 0; cells[i]; i++) {
        const char *cell = g_strstrip(cells[i]);
        struct nearest nearest = nearest_new(cell);
        if (i == c->name || i == c->x || i == c->y || i == c->z || i == c->theta || i == c->phi ||
            i == c->exponent || strlen(cell) < 3)
            continue;
        for (const char *const *name = known; *name; name++)
            nearest_consider(&nearest, *name);
        if (nearest.name)
            return g_strdup_printf("column “%s” is not known; did you mean %s?", cell,
                                   nearest.name);
    }
    return NULL;
}

/* Returns whether a line names the columns theta and phi, or x, y and z, or x_mm, y_mm and z_mm,
 * and sets their indices. Columns of names and, with x_mm, of exponents are optional. */
static gboolean parse_head(const char *text, struct columns *ret) {
    static const char separators[] = ",;\t";
    for (const char *s = separators; *s; s++) {
        struct columns c = {{*s}, -1, -1, -1, -1, -1, -1, -1, 0, FALSE, FALSE};
        g_autofree char *lower = g_ascii_strdown(text, -1);
        g_auto(GStrv) cells = g_strsplit(g_strdelimit(lower, "\"", ' '), c.separator, -1);
        for (int i = 0; cells[i]; i++) {
            static const char *const names[] = {"name",  "filename", "file",
                                                "image", "picture",  NULL};
            const char *cell = g_strstrip(cells[i]);
            int *to = g_strv_contains(names, cell)      ? &c.name
                      : g_str_equal(cell, "x")          ? &c.x
                      : g_str_equal(cell, "y")          ? &c.y
                      : g_str_equal(cell, "z")          ? &c.z
                      : g_str_equal(cell, "x_mm")       ? &c.x
                      : g_str_equal(cell, "y_mm")       ? &c.y
                      : g_str_equal(cell, "z_mm")       ? &c.z
                      : g_str_equal(cell, "exponent")   ? &c.exponent
                      : g_str_has_prefix(cell, "theta") ? &c.theta
                      : g_str_has_prefix(cell, "phi")   ? &c.phi
                                                        : NULL;
            c.radians |= to == &c.theta && strstr(cell, "rad");
            c.mm |= (to == &c.x || to == &c.y || to == &c.z) && g_str_has_suffix(cell, "_mm");
            if (to)
                *to = c.most = i;
        }
        *ret = c;
        if ((c.theta >= 0 && c.phi >= 0) || (c.x >= 0 && c.y >= 0 && c.z >= 0))
            return TRUE;
    }
    return FALSE;
}

static gboolean is_count(const char *text, gint64 *ret) {
    char *end;
    const gint64 count = g_ascii_strtoll(text, &end, 10);
    if (end == text || *end)
        return FALSE;
    *ret = count;
    return TRUE;
}

/* Returns FALSE if so many lights are on the horizon that the columns must have another meaning. */
static gboolean check_horizon(const struct list *list, GError **error) {
    const struct import_light *first = NULL;
    guint n = 0;
    for (guint i = 0; i < list->lights->len; i++) {
        const struct import_light *light = &g_array_index(list->lights, struct import_light, i);
        if (light->on_horizon && n++ == 0)
            first = light;
    }
    return n == 0 || (2 * n < list->lights->len && n <= MAX(1, MAX_ON_IT * list->lights->len)) ||
           data_error_fail(
               list->path, first->line, error,
               "%u of %u lights are not above the sample, and this is the first of them; z must "
               "be the height above the sample, or theta the angle from the normal",
               n, list->lights->len);
}

GArray *import_lights_read(const char *path, GError **error) {
    GError *found = NULL;
    g_autofree char *text = input_file_read_text(path, MAX_LIST_BYTES, &found);
    g_autoptr(GArray) lights = g_array_new(FALSE, FALSE, sizeof(struct import_light));
    struct list list = {.path = path, .lights = lights};
    gboolean table = FALSE, begun = FALSE;
    if (!text) {
        input_file_propagate(found, DATA_ERROR, DATA_ERROR_INVALID, DATA_ERROR_INVALID, error);
        return NULL;
    }
    g_array_set_clear_func(lights, light_clear);
    g_auto(GStrv) lines = text_table_lines(text);
    for (int i = 0; lines[i]; i++) {
        const char *line = g_strstrip(lines[i]);
        if (!*line || *line == '#')
            continue;
        const gboolean first = !begun;
        begun = TRUE;
        if (first && is_count(line, &list.count)) {
            list.count_line = i + 1;
            if (list.count < 1 || list.count > MAX_LIGHTS) {
                data_error_set(path, i + 1, error,
                               "the number of pictures is %s; it must be 1 to %d", line,
                               MAX_LIGHTS);
                return NULL;
            }
        } else if (first && parse_head(line, &list.columns)) {
            g_autofree char *wrong = misspelt(line, &list.columns);
            table = TRUE;
            if (wrong) {
                data_error_set(path, i + 1, error, "%s", wrong);
                return NULL;
            }
        } else if (!(table ? parse_cells : parse_words)(&list, i + 1, line, error)) {
            return NULL;
        }
    }
    if (lights->len == 0 && list.count == 0)
        data_error_set(
            path, 1, error,
            "the list is empty; its first line must be the number of pictures, or " EXPECTED);
    else if (list.count > 0 && lights->len != list.count)
        data_error_set(path, list.count_line, error,
                       "this line states %d pictures, but the file lists %u; correct the number, "
                       "or list every picture",
                       (int)list.count, lights->len);
    else if (check_horizon(&list, error))
        return g_steal_pointer(&lights);
    return NULL;
}
