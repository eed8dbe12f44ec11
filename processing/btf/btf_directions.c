#include "btf_directions.h"

#include <math.h>
#include <string.h>

#include "base/data_error.h"
#include "base/text_table.h"

#define MOST     4096
#define LOWEST   89.0 /* maximum θ in degrees; nothing can be measured closer to the horizon */
#define SAME_DEG 0.01

void btf_directions_free(struct btf_directions *directions) {
    if (!directions)
        return;
    g_free(directions->name);
    direction_list_clear(&directions->views);
    direction_list_clear(&directions->lights);
    g_free(directions);
}

/* Makes rings at θ = 0°, 15° … 75°. The n azimuths of a ring are φ = 360° k / n, k = 0 … n − 1. */
struct btf_directions *btf_directions_81(void) {
    static const int counts[] = {1, 6, 12, 18, 20, 24};
    struct btf_directions *ret = g_new0(struct btf_directions, 1);
    ret->name = g_strdup("81");
    ret->views = direction_list_new(81);
    for (gsize ring = 0, n = 0; ring < G_N_ELEMENTS(counts); ring++)
        for (int k = 0; k < counts[ring]; k++, n++) {
            ret->views.theta_deg[n] = 15.0f * (float)ring;
            ret->views.phi_deg[n] = 360.0f * (float)k / (float)counts[ring];
        }
    ret->lights = direction_list_copy(&ret->views);
    return ret;
}

/* Adds a direction to a list of at most MOST directions. `what` is "view" or "light". Returns FALSE
 * with an error if the list contains the direction or is full. Directions are compared by the angle
 * between them, because φ wraps around, and because a difference in φ is a smaller angle near the
 * pole. */
static gboolean add(const TextTable *table, int row, const char *what, double theta, double phi,
                    struct direction_list *to, GError **error) {
    const char *path = text_table_path(table);
    const int line = text_table_line(table, row);
    for (gsize i = 0; i < to->n; i++) {
        const double across =
            remainder(phi - (double)to->phi_deg[i], 360) * sin(theta * G_PI / 180);
        if (hypot(theta - (double)to->theta_deg[i], across) < SAME_DEG)
            return data_error_fail(path, line, error,
                                   "the %s θ %g°, φ %g° repeats an earlier row; give it only once",
                                   what, theta, phi);
    }
    if (to->n >= MOST)
        return data_error_fail(path, line, error, "the table has more than %d %ss; remove some",
                               MOST, what);
    to->theta_deg[to->n] = (float)theta;
    to->phi_deg[to->n++] = (float)phi;
    return TRUE;
}

static gboolean read_row(const TextTable *table, int row, const int columns[3],
                         struct btf_directions *to, GError **error) {
    const char *of = text_table_text(table, row, columns[0]);
    const gboolean both = strcmp(of, "both") == 0;
    const gboolean view = both || strcmp(of, "view") == 0, light = both || strcmp(of, "light") == 0;
    double theta, phi;
    if (!view && !light)
        return data_error_fail(text_table_path(table), text_table_line(table, row), error,
                               "the column “of” has “%s”, but must have “view”, “light” or “both”",
                               of);
    if (!text_table_number(table, row, columns[1], NAN, &theta, error) ||
        !text_table_number(table, row, columns[2], NAN, &phi, error))
        return FALSE;
    if (!(theta >= 0 && theta <= LOWEST))
        return data_error_fail(text_table_path(table), text_table_line(table, row), error,
                               "theta_deg is %g, but must be 0 to %g", theta, LOWEST);
    if (!(fabs(phi) <= 720))
        return data_error_fail(text_table_path(table), text_table_line(table, row), error,
                               "phi_deg is %g, but must be −720 to 720", phi);
    return (!view || add(table, row, "view", theta, phi, &to->views, error)) &&
           (!light || add(table, row, "light", theta, phi, &to->lights, error));
}

static gboolean read_rows(const TextTable *table, struct btf_directions *to, GError **error) {
    static const char *const known[] = {"of", "theta_deg", "phi_deg", NULL};
    const char *path = text_table_path(table);
    if (!text_table_check_columns(table, known, error))
        return FALSE;
    int columns[3];
    for (gsize i = 0; i < G_N_ELEMENTS(columns); i++) {
        columns[i] = text_table_column(table, known[i]);
        if (columns[i] < 0)
            return data_error_fail(path, 0, error,
                                   "the column “%s” is missing; a table of directions needs the "
                                   "columns “of”, “theta_deg” and “phi_deg”",
                                   known[i]);
    }
    for (int row = 0; row < text_table_rows(table); row++)
        if (!read_row(table, row, columns, to, error))
            return FALSE;
    if (to->views.n == 0 || to->lights.n == 0)
        return data_error_fail(
            path, 0, error, "the table has no %s; add a row whose column “of” is “%s” or “both”",
            to->views.n == 0 ? "view" : "light", to->views.n == 0 ? "view" : "light");
    return TRUE;
}

struct btf_directions *btf_directions_read(const char *path, GError **error) {
    g_autoptr(TextTable) table = text_table_read(path, error);
    if (!table)
        return NULL;
    struct btf_directions *ret = g_new0(struct btf_directions, 1);
    ret->name = g_path_get_basename(path);
    ret->views = direction_list_new(MOST);
    ret->lights = direction_list_new(MOST);
    ret->views.n = ret->lights.n = 0;
    if (!read_rows(table, ret, error))
        g_clear_pointer(&ret, btf_directions_free);
    return ret;
}
