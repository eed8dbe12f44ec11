#include "marks.h"

#include "directions.h"
#include "gpu.h"

#include <epoxy/gl.h>
#include <math.h>

#define CELLS 256 /* of the hemisphere's square, each way */

struct Marks {
    guint program, missing, array;
    gboolean any;
};

Marks *marks_new(GError **error) {
    static const char *const names[] = {"screen.vert", "directions.glsl", "marks.frag", NULL};
    g_autoptr(Marks) marks = g_new0(Marks, 1);
    if ((marks->program = gpu_program(names, error)) == 0)
        return NULL;
    glGenVertexArrays(1, &marks->array);
    marks->missing = gpu_texture(GL_R8, CELLS, CELLS, 0);
    return g_steal_pointer(&marks);
}

void marks_free(Marks *marks) {
    if (marks == NULL)
        return;
    glDeleteProgram(marks->program);
    glDeleteTextures(1, &marks->missing);
    glDeleteVertexArrays(1, &marks->array);
    g_free(marks);
}

static struct vec3 unit(const struct live_view *view) {
    const double theta = view->theta_deg * G_PI / 180.0, phi = view->phi_deg * G_PI / 180.0;
    return vec3(sin(theta) * cos(phi), sin(theta) * sin(phi), cos(theta));
}

static gboolean nearest_is_missing(const struct live_view *views, const struct vec3 *units, guint n,
                                   struct vec3 d) {
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

void marks_set(Marks *marks, const struct live_view *views, guint n) {
    g_autofree struct vec3 *units = g_new(struct vec3, MAX(n, 1));
    g_autofree guint8 *cells = g_new(guint8, CELLS * CELLS);
    marks->any = FALSE;
    for (guint k = 0; k < n; k++) {
        units[k] = unit(&views[k]);
        marks->any |= !views[k].measured;
    }
    if (!marks->any)
        return;
    for (int j = 0; j < CELLS; j++)
        for (int i = 0; i < CELLS; i++) {
            const struct vec3 d = directions_from_square((2.0 * i + 1.0) / CELLS - 1.0,
                                                         (2.0 * j + 1.0) / CELLS - 1.0);
            cells[j * CELLS + i] = nearest_is_missing(views, units, n, d) ? 255 : 0;
        }
    glActiveTexture(GL_TEXTURE0);
    glBindTexture(GL_TEXTURE_2D, marks->missing);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    glTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, CELLS, CELLS, GL_RED, GL_UNSIGNED_BYTE, cells);
}

gboolean marks_any(const Marks *marks) {
    return marks->any;
}

void marks_draw(const Marks *marks, guint directions, guint framebuffer, int width, int height) {
    const guint textures[2] = {directions, marks->missing};
    static const char *const names[2] = {"seen_from", "missing"};
    glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
    glViewport(0, 0, width, height);
    glDisable(GL_DEPTH_TEST);
    glEnable(GL_BLEND);
    glBlendFunc(GL_SRC_ALPHA, GL_ONE_MINUS_SRC_ALPHA);
    glUseProgram(marks->program);
    for (int k = 0; k < 2; k++) {
        glActiveTexture(GL_TEXTURE0 + k);
        glBindTexture(GL_TEXTURE_2D, textures[k]);
        glUniform1i(glGetUniformLocation(marks->program, names[k]), k);
    }
    glBindVertexArray(marks->array);
    glDrawArrays(GL_TRIANGLES, 0, 3);
    glBindVertexArray(0);
    glDisable(GL_BLEND);
    glActiveTexture(GL_TEXTURE0);
}
