#include "hatching.h"

#include "directions/directions.h"
#include "drawing/gl/gpu.h"

#include <epoxy/gl.h>
#include <math.h>

#define CELLS 256 /* cells of the hemisphere's square in each direction */

struct Hatching {
    /* `missing` is a texture that is 1 where the nearest planned view is missing */
    guint program, missing;
    gboolean any; /* whether a planned view is missing */
};

Hatching *hatching_new(GError **error) {
    static const char *const names[] = {"screen.vert", "directions.glsl", "hatching.frag", NULL};
    g_autoptr(Hatching) hatching = g_new0(Hatching, 1);
    if ((hatching->program = gpu_program("", names, error)) == 0)
        return NULL;
    hatching->missing = gpu_texture(GL_R8, CELLS, CELLS, 0);
    return g_steal_pointer(&hatching);
}

void hatching_free(Hatching *hatching) {
    if (hatching == NULL)
        return;
    glDeleteProgram(hatching->program);
    glDeleteTextures(1, &hatching->missing);
    g_free(hatching);
}

static struct vec3 unit(const struct planned_view *view) {
    const double theta = view->theta_deg * G_PI / 180.0, phi = view->phi_deg * G_PI / 180.0;
    return vec3(sin(theta) * cos(phi), sin(theta) * sin(phi), cos(theta));
}

static gboolean nearest_is_missing(const struct planned_view *views, const struct vec3 *units,
                                   guint n, struct vec3 d) {
    double best = -2.0;
    gboolean missing = FALSE;
    for (guint k = 0; k < n; k++) {
        const double dot = vec3_dot(units[k], d);
        if (dot > best) {
            best = dot;
            missing = !views[k].measured;
        }
    }
    return missing;
}

gboolean planned_views_missing(const struct planned_view *views, guint n, double theta_deg,
                               double phi_deg) {
    const struct planned_view at = {theta_deg, phi_deg, FALSE};
    g_autofree struct vec3 *units = g_new(struct vec3, MAX(n, 1));
    for (guint k = 0; k < n; k++)
        units[k] = unit(&views[k]);
    return nearest_is_missing(views, units, n, unit(&at));
}

void hatching_set(Hatching *hatching, const struct planned_view *views, guint n) {
    g_autofree struct vec3 *units = g_new(struct vec3, MAX(n, 1));
    g_autofree guint8 *cells = g_new(guint8, CELLS * CELLS);
    hatching->any = FALSE;
    for (guint k = 0; k < n; k++) {
        units[k] = unit(&views[k]);
        hatching->any |= !views[k].measured;
    }
    if (!hatching->any)
        return;
    for (int j = 0; j < CELLS; j++)
        for (int i = 0; i < CELLS; i++) {
            const struct vec3 d = directions_from_square((2.0 * i + 1.0) / CELLS - 1.0,
                                                         (2.0 * j + 1.0) / CELLS - 1.0);
            cells[j * CELLS + i] = nearest_is_missing(views, units, n, d) ? 255 : 0;
        }
    glActiveTexture(GL_TEXTURE0);
    glBindTexture(GL_TEXTURE_2D, hatching->missing);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    glTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, CELLS, CELLS, GL_RED, GL_UNSIGNED_BYTE, cells);
}

gboolean hatching_any(const Hatching *hatching) {
    return hatching->any;
}

void hatching_draw(const Hatching *hatching, guint directions, guint framebuffer, int width,
                   int height) {
    glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
    glViewport(0, 0, width, height);
    glDisable(GL_DEPTH_TEST);
    glEnable(GL_BLEND);
    glBlendFunc(GL_SRC_ALPHA, GL_ONE_MINUS_SRC_ALPHA);
    glUseProgram(hatching->program);
    gpu_bind_texture(hatching->program, "seen_from", 0, GL_TEXTURE_2D, directions);
    gpu_bind_texture(hatching->program, "missing", 1, GL_TEXTURE_2D, hatching->missing);
    gpu_fill_screen();
    glDisable(GL_BLEND);
}
