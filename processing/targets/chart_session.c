/* Reflectance of chart patches in the geometry 45°:0°. The reflectance of a patch is Σ values / Σ
 * cos θ_l over its texels and over the lights near 45°, in the view nearest to the normal. */
#include "chart_session.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/text_table.h"
#include "btf/btf.h"

/* A light is used if its θ is at most NEAR_DEG farther from 45° than that of the light nearest to
 * 45°. */
#define NEAR_DEG     2.0
#define FARTHEST_DEG 20.0 /* maximum deviation from the geometry 45°:0° */
#define CHART_DEG    45.0

static gboolean parse_line(const char *line, struct chart_field *ret) {
    double *const to[] = {&ret->x_mm,   &ret->y_mm,   &ret->radius_mm,
                          &ret->xyz[0], &ret->xyz[1], &ret->xyz[2]};
    const char *separator = strchr(line, ';') ? ";" : strchr(line, '\t') ? "\t" : ",";
    g_auto(GStrv) words = g_strsplit(line, separator, 8);
    if (g_strv_length(words) != G_N_ELEMENTS(to))
        return FALSE;
    for (gsize i = 0; i < G_N_ELEMENTS(to); i++) {
        if (!text_table_parse(g_strstrip(words[i]), *separator != ',', to[i]) || fabs(*to[i]) > 1e4)
            return FALSE;
    }
    return ret->radius_mm > 0 && ret->xyz[1] > 0 && ret->xyz[1] < 2;
}

GArray *chart_parse(const char *text, const char *path, GError **error) {
    g_auto(GStrv) lines = text_table_lines(text);
    g_autoptr(GArray) fields = g_array_new(FALSE, FALSE, sizeof(struct chart_field));
    for (int i = 0; lines[i]; i++) {
        struct chart_field field = {0};
        g_autofree char *line = g_strndup(lines[i], strcspn(lines[i], "#"));
        if (*g_strstrip(line) == '\0')
            continue;
        if (!parse_line(line, &field)) {
            g_set_error(
                error, COLOUR_ERROR, COLOUR_ERROR_FILE,
                "%s:%d: \"%s\" is not x_mm,y_mm,radius_mm,X,Y,Z: six numbers, radius_mm above 0, "
                "and Y above 0 and below 2 with Y = 1 for white",
                path, i + 1, line);
            return NULL;
        }
        g_array_append_val(fields, field);
    }
    return g_steal_pointer(&fields);
}

struct chart {
    struct session_grid grid;
    struct rig rig;
    GPtrArray *views, *lights;
    GArray *near; /* of int: indices of the lights that are used */
    float *rgb;   /* near->len × texels × 3: BTF values of the view nearest to the normal */
};

/* Returns the absolute difference between a light's θ and 45°. */
static double off_45(const struct session_direction *light) {
    return fabs(light->theta_deg - CHART_DEG);
}

/* Loads the view nearest to the normal, under all lights that are used (NEAR_DEG). */
static gboolean load(struct chart *chart, Session *session, GError **error) {
    g_autofree char *text = session_text(session, "calibration.conf", error);
    const struct session_direction *view = NULL;
    double least = HUGE_VAL;
    if (!text || !rig_from_text(&chart->rig, text, session_path(session), error) ||
        !session_grid(session, &chart->grid, error) ||
        !(chart->views = session_views(session, error)) ||
        !(chart->lights = session_lights(session, error)))
        return FALSE;
    for (guint i = 0; i < chart->views->len; i++) {
        const struct session_direction *one = chart->views->pdata[i];
        view = !view || one->theta_deg < view->theta_deg ? one : view;
    }
    for (guint i = 0; i < chart->lights->len; i++)
        least = MIN(least, off_45(chart->lights->pdata[i]));
    for (guint i = 0; i < chart->lights->len; i++)
        if (off_45(chart->lights->pdata[i]) < least + NEAR_DEG)
            g_array_append_val(chart->near, i);
    if (!view || !(view->theta_deg <= FARTHEST_DEG)) {
        g_set_error(
            error, COLOUR_ERROR, COLOUR_ERROR_TOO_FEW,
            "%s: a chart is measured from above, but the session has no view within %.0f° of "
            "the normal; plan such a view and capture it",
            session_path(session), FARTHEST_DEG);
        return FALSE;
    }
    if (!(least <= FARTHEST_DEG)) {
        g_set_error(
            error, COLOUR_ERROR, COLOUR_ERROR_TOO_FEW,
            "%s: a chart is measured under light at 45°, but the session has no light within "
            "%.0f° of 45°; plan such a light and capture it",
            session_path(session), FARTHEST_DEG);
        return FALSE;
    }
    g_autofree char *name = g_strdup_printf("products/btf/view_%04d.exr", view->index);
    g_autofree char *path = session_file(session, name);
    chart->rgb =
        g_new(float, (gsize)chart->grid.width *(gsize)chart->grid.height * 3 * chart->near->len);
    return session_check_products(session, name, NULL, error) &&
           btf_read_view(path, (const int *)(void *)chart->near->data, (int)chart->near->len,
                         &chart->grid, 0, chart->rgb, error);
}

/* Sets ret->rgb to the reflectance of a patch: the sum of the values divided by the sum of cos θ_l.
 * (A perfect white has the values cos θ_l.) Both sums are over the texels within the patch's disc
 * and over the lights. Copies xyz of the field. Returns FALSE if the disc contains no texel. */
static gboolean measure_field(const struct chart *chart, const struct chart_field *field,
                              struct colour_patch *ret) {
    const int width = chart->grid.width, n = width * chart->grid.height;
    double seen[3] = {0}, white = 0;
    for (int t = 0; t < n; t++) {
        const int row = t / width, column = t % width;
        struct vec3 p = rectify_point_mm(&chart->grid, column + 0.5, row + 0.5);
        if (!(hypot(p.x - field->x_mm, p.y - field->y_mm) <= field->radius_mm))
            continue;
        for (guint i = 0; i < chart->near->len; i++) {
            const struct session_direction *light =
                chart->lights->pdata[g_array_index(chart->near, int, i)];
            double away = vec3_length(chart->rig.lamps[light->device].position_mm);
            struct vec3 lamp = vec3_scale(
                rig_direction(light->theta_deg * G_PI / 180, light->phi_deg * G_PI / 180), away);
            struct vec3 to_lamp = vec3_sub(lamp, p);
            const float *rgb = chart->rgb + ((gsize)i * (gsize)n + (gsize)t) * 3;
            white += to_lamp.z / vec3_length(to_lamp);
            for (int k = 0; k < 3; k++)
                seen[k] += (double)rgb[k];
        }
    }
    for (int k = 0; k < 3; k++) {
        ret->rgb[k] = white > 0 ? seen[k] / white : 0;
        ret->xyz[k] = field->xyz[k];
    }
    return white > 0;
}

gboolean chart_session(Session *session, const GArray *fields, struct colour_patch *ret,
                       GError **error) {
    struct chart chart = {.near = g_array_new(FALSE, FALSE, sizeof(int))};
    gboolean ok = load(&chart, session, error);
    for (guint i = 0; ok && i < fields->len; i++) {
        const struct chart_field *field = &g_array_index(fields, struct chart_field, i);
        ok = measure_field(&chart, field, &ret[i]);
        if (!ok)
            g_set_error(error, COLOUR_ERROR, COLOUR_ERROR_FILE,
                        "patch %u at %g, %g mm contains no texel of the session's sample of %g × "
                        "%g mm; correct the position or the radius of the patch",
                        i + 1, field->x_mm, field->y_mm, chart.grid.width_mm, chart.grid.height_mm);
    }
    g_array_unref(chart.near);
    g_clear_pointer(&chart.views, g_ptr_array_unref);
    g_clear_pointer(&chart.lights, g_ptr_array_unref);
    g_free(chart.rgb);
    return ok;
}
