/* Lists of the lights of one view, in the forms in which such sets are published. */
#include "import_private.h"

#include <math.h>
#include <string.h>

#include "base/data_error.h"
#include "base/input_file.h"

#define MOST_LIGHTS    65536
#define MAX_LIST_BYTES (64 << 20)
#define LEAST_LENGTH   0.5 /* of a direction in a list, which should be a unit vector */
#define DEG            (180 / G_PI)
#define EXPECTED       "a picture's name and x, y, z of the direction to its light"

/* What the columns of a table mean; −1: there is no such column. */
struct columns {
    char separator[2];
    int name, x, y, z, theta, phi, most;
    gboolean radians;
};

struct list {
    const char *path;
    GArray *lights; /* of struct import_light */
    struct columns columns;
    gint64 count; /* number that the list states; 0: none */
    int count_line;
};

static void import_light_clear(gpointer data) {
    g_free(((struct import_light *)data)->name);
}

static gboolean import_lights_number(const struct list *list, int line, const char *word,
                                     double *ret, GError **error) {
    char *end;
    *ret = g_ascii_strtod(word, &end);
    return (end > word && !*end && isfinite(*ret)) ||
           data_error_fail(list->path, line, error, "“%s” is not a number", word);
}

static gboolean is_number(const char *word) {
    char *end;
    g_ascii_strtod(word, &end);
    return end > word && !*end;
}

/* Adds a light, and takes its name, which may be a path on another machine, with either kind of
 * slash. */
static gboolean import_lights_add(struct list *list, int line, char *name, const double d[3],
                                  GError **error) {
    const double length = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    const char *slash = name ? strrchr(name, '/') : NULL;
    const char *other = name ? strrchr(name, '\\') : NULL;
    const struct import_light *first = (const struct import_light *)(gpointer)list->lights->data;
    const struct import_light light = {.name = MAX(slash, other) ? g_strdup(MAX(slash, other) + 1)
                                                                 : g_strdup(name),
                                       .theta_deg = acos(CLAMP(d[2] / length, -1, 1)) * DEG,
                                       .phi_deg = atan2(d[1], d[0]) * DEG,
                                       .line = line};
    const gboolean mixed = list->lights->len > 0 && (first->name == NULL) != (name == NULL);
    const gboolean named = name != NULL;
    g_free(name);
    g_array_append_val(list->lights, light);
    if (length < LEAST_LENGTH || d[2] <= 0)
        return data_error_fail(list->path, line, error,
                               "%g %g %g is not a direction to a light above the sample", d[0],
                               d[1], d[2]);
    if (list->lights->len > MOST_LIGHTS)
        return data_error_fail(list->path, line, error, "it lists more than %d lights",
                               MOST_LIGHTS);
    return !mixed || data_error_fail(list->path, line, error,
                                     named ? "this line has a picture's name, the first one has "
                                             "none; name all pictures, or none"
                                           : "a picture's name is expected before x, y, z, as the "
                                             "lines before have it");
}

/* "name x y z" or "x y z"; the name may contain blanks. */
static gboolean parse_words(struct list *list, int line, const char *text, GError **error) {
    g_autofree char *copy = g_strdelimit(g_strdup(text), "\t,;", ' ');
    char *words[3] = {NULL};
    double d[3];
    int n = 0;
    while (n < 3 && *g_strchomp(copy)) {
        char *blank = strrchr(copy, ' ');
        words[2 - n++] = blank ? blank + 1 : copy;
        if (!blank)
            break;
        *blank = '\0';
    }
    const gboolean nameless = n == 3 && words[0] == copy;
    if (n < 3 || (nameless && !is_number(words[0])))
        return data_error_fail(
            list->path, line, error, "%s" EXPECTED " are expected",
            list->lights->len == 0 && list->count == 0 ? "the number of pictures, or " : "");
    for (int i = 0; i < 3; i++)
        if (!import_lights_number(list, line, words[i], &d[i], error))
            return FALSE;
    /* The rest of the text is the name, with its own separators. */
    char *name = nameless ? NULL : g_strndup(text, strlen(g_strchomp(copy)));
    return import_lights_add(list, line, name, d, error);
}

static gboolean parse_cells(struct list *list, int line, const char *text, GError **error) {
    const struct columns *c = &list->columns;
    g_auto(GStrv) cells = g_strsplit(text, c->separator, -1);
    double d[3];
    for (char **cell = cells; *cell; cell++)
        g_strstrip(g_strdelimit(*cell, "\"", ' '));
    if ((int)g_strv_length(cells) <= c->most)
        return data_error_fail(list->path, line, error,
                               "it has %u columns; at least %d are expected, as the first line "
                               "names them",
                               g_strv_length(cells), c->most + 1);
    if (c->theta < 0) {
        if (!import_lights_number(list, line, cells[c->x], &d[0], error) ||
            !import_lights_number(list, line, cells[c->y], &d[1], error) ||
            !import_lights_number(list, line, cells[c->z], &d[2], error))
            return FALSE;
    } else {
        double theta, phi;
        if (!import_lights_number(list, line, cells[c->theta], &theta, error) ||
            !import_lights_number(list, line, cells[c->phi], &phi, error))
            return FALSE;
        const double unit = c->radians ? DEG : 1;
        if (!(theta >= 0 && theta * unit < 90))
            return data_error_fail(list->path, line, error,
                                   "theta is %g%s; the angle from the normal is expected, from 0 "
                                   "to below %s",
                                   theta, c->radians ? "" : "°", c->radians ? "π/2" : "90°");
        theta *= unit / DEG;
        phi *= unit / DEG;
        d[0] = sin(theta) * cos(phi);
        d[1] = sin(theta) * sin(phi);
        d[2] = cos(theta);
    }
    if (c->name >= 0 && !*cells[c->name])
        return data_error_fail(list->path, line, error, "a picture's name is expected in column %d",
                               c->name + 1);
    return import_lights_add(list, line, c->name >= 0 ? g_strdup(cells[c->name]) : NULL, d, error);
}

/* Whether a line names columns: theta and phi, or x, y and z, and perhaps the picture. */
static gboolean parse_head(const char *text, struct columns *ret) {
    static const char separators[] = ",;\t";
    for (const char *s = separators; *s; s++) {
        struct columns c = {{*s}, -1, -1, -1, -1, -1, -1, 0, FALSE};
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
                      : g_str_has_prefix(cell, "theta") ? &c.theta
                      : g_str_has_prefix(cell, "phi")   ? &c.phi
                                                        : NULL;
            c.radians |= to == &c.theta && strstr(cell, "rad");
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
    g_array_set_clear_func(lights, import_light_clear);
    /* Editors of Windows begin a file with U+FEFF. */
    g_auto(GStrv) lines =
        g_strsplit(text + (g_str_has_prefix(text, "\xef\xbb\xbf") ? 3 : 0), "\n", -1);
    for (int i = 0; lines[i]; i++) {
        const char *line = g_strstrip(lines[i]);
        if (!*line || *line == '#')
            continue;
        const gboolean first = !begun;
        begun = TRUE;
        if (first && is_count(line, &list.count)) {
            list.count_line = i + 1;
            if (list.count < 1 || list.count > MOST_LIGHTS) {
                data_error_set(path, i + 1, error,
                               "the number of pictures is %s; 1 to %d are expected", line,
                               MOST_LIGHTS);
                return NULL;
            }
        } else if (first && parse_head(line, &list.columns)) {
            table = TRUE;
        } else if (!(table ? parse_cells : parse_words)(&list, i + 1, line, error)) {
            return NULL;
        }
    }
    if (lights->len == 0 && list.count == 0)
        data_error_set(path, 1, error, "the number of pictures, or " EXPECTED " are expected");
    else if (list.count > 0 && lights->len != list.count)
        data_error_set(path, list.count_line, error,
                       "this line says that there are %d pictures, but the file lists %u; "
                       "correct the number, or list every picture",
                       (int)list.count, lights->len);
    else
        return g_steal_pointer(&lights);
    return NULL;
}
