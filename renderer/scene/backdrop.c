#include "backdrop.h"

#include "base/direction.h"
#include "camera.h"
#include "drawing/gl/gpu.h"
#include "lamp.h"
#include "programs.h"

#include <epoxy/gl.h>
#include <math.h>

#define MOST 6e4f /* close to the largest half float, 65504 */

enum { GROUND, GROUND_LAMPS, GROUND_NEAR, ENVIRONMENT, N_PROGRAMS };
enum { SHARP, SOFT, N_SHADOWS };

struct Backdrop {
    guint programs[N_PROGRAMS][N_SHADOWS]; /* each is compiled when it is first used */
    guint environment;                     /* texture of the environment map; 0 if there is none */
    /* Footprint of the mesh: [0] and [1] are half its size in x and in y, and [2] is the lowest z
     * of the mesh. */
    float foot[3];
    float corner; /* radius of the corners of the footprint */
    float radius; /* radius of the mesh */
};

static gboolean need(Backdrop *backdrop, int which, int shadows, GError **error) {
    static const char *const constants[N_PROGRAMS] = {
        "#define LAMP_SHADOWS 0\n", "#define LAMP_SHADOWS 1\n",
        "#define LAMP_SHADOWS 1\n#define NEAR_LAMPS\n", ""};
    static const char *const ground[] = {"screen.vert", "shadow.glsl", "further.glsl",
                                         "background.frag", NULL};
    static const char *const environment[] = {"screen.vert", "environment.frag", NULL};
    guint *program = &backdrop->programs[which][shadows];
    g_autofree char *all =
        g_strconcat(shadows == SOFT ? "#define SOFT_SHADOWS\n" : "", constants[which], NULL);
    if (*program == 0)
        *program = gpu_program(all, which == ENVIRONMENT ? environment : ground, error);
    return *program != 0;
}

Backdrop *backdrop_new(GError **error) {
    g_autoptr(Backdrop) backdrop = g_new0(Backdrop, 1);
    if (!need(backdrop, GROUND, SHARP, error))
        return NULL;
    return g_steal_pointer(&backdrop);
}

void backdrop_free(Backdrop *backdrop) {
    if (backdrop == NULL)
        return;
    for (int k = 0; k < N_PROGRAMS * N_SHADOWS; k++)
        glDeleteProgram(backdrop->programs[k / N_SHADOWS][k % N_SHADOWS]);
    glDeleteTextures(1, &backdrop->environment);
    g_free(backdrop);
}

/* The footprint is the lowest quarter of the mesh, seen from above. It is modelled as a rectangle
 * with rounded corners. The radius of the corners is 0 for a square plane, and half the width for a
 * torus. */
void backdrop_set_points(Backdrop *backdrop, const float *points, guint n, double radius) {
    double reach = 0.0, x = 0.0, y = 0.0, low = 0.0, high = 0.0;
    for (guint k = 0; k < n; k++) {
        low = MIN(low, points[3 * k + 2]);
        high = MAX(high, points[3 * k + 2]);
    }
    for (guint k = 0; k < n; k++) {
        const float *p = points + 3 * (gsize)k;
        if (p[2] > low + 0.25 * (high - low))
            continue;
        x = MAX(x, fabsf(p[0]));
        y = MAX(y, fabsf(p[1]));
        reach = MAX(reach, hypot((double)p[0], (double)p[1]));
    }
    double missing = (hypot(x, y) - reach) / (MAX(MIN(x, y), 1e-6) * (M_SQRT2 - 1.0));
    backdrop->foot[0] = (float)x;
    backdrop->foot[1] = (float)y;
    backdrop->foot[2] = (float)low;
    backdrop->corner = (float)(MIN(x, y) * CLAMP(missing, 0.0, 1.0));
    backdrop->radius = (float)radius;
}

gboolean backdrop_set_environment(Backdrop *backdrop, const struct environment *environment,
                                  GError **error) {
    GLint largest = 0;
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &largest);
    if (environment->width > largest) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
                    "the environment map has %d × %d pixels, but %s supports only %d in each "
                    "direction; make it smaller, or omit --backdrop",
                    environment->width, environment->height, gpu_renderer(), largest);
        return FALSE;
    }
    const gsize n = 3 * (gsize)environment->width * environment->height;
    g_autofree float *rgb = g_new(float, n);
    for (gsize k = 0; k < n; k++)
        rgb[k] = MIN(environment->rgb[k], MOST);
    glActiveTexture(GL_TEXTURE0);
    glDeleteTextures(1, &backdrop->environment);
    backdrop->environment = gpu_texture(GL_RGB16F, environment->width, environment->height, 0);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    glTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, environment->width, environment->height, GL_RGB,
                    GL_FLOAT, rgb);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_LINEAR);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_S, GL_REPEAT);
    return gpu_check("the environment", error);
}

gboolean backdrop_draw(Backdrop *backdrop, const struct viewer_settings *s, const Relief *relief,
                       const float projection[16], const float eye[3], GError **error) {
    const int which = s->backdrop                       ? ENVIRONMENT
                      : !(s->shadows && s->n_lamps > 0) ? GROUND
                      : lamp_any_near(s)                ? GROUND_NEAR
                                                        : GROUND_LAMPS;
    if (which == ENVIRONMENT && backdrop->environment == 0) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                    "--backdrop needs an environment map; name one with --environment FILE.exr");
        return FALSE;
    }
    const int shadows = s->shadows && s->light_size_deg > 0.0 ? SOFT : SHARP;
    if (!need(backdrop, which, shadows, error))
        return FALSE;
    const guint program = backdrop->programs[which][shadows];
    glUseProgram(program);
    glUniformMatrix4fv(glGetUniformLocation(program, "projection"), 1, GL_FALSE, projection);
    glUniform3fv(glGetUniformLocation(program, "eye"), 1, eye);
    if (which == ENVIRONMENT) {
        gpu_bind_texture(program, "environment", 0, GL_TEXTURE_2D, backdrop->environment);
        glUniform1f(glGetUniformLocation(program, "exposure"), (float)viewer_settings_exposure(s));
        glUniform1f(glGetUniformLocation(program, "turn"),
                    (float)(s->environment_turn_deg * G_PI / 180.0));
    } else {
        float light[3];
        direction_from_deg(s->light_theta_deg, s->light_phi_deg, light);
        glUniform3fv(glGetUniformLocation(program, "foot"), 1, backdrop->foot);
        glUniform1f(glGetUniformLocation(program, "corner"), backdrop->corner);
        glUniform1f(glGetUniformLocation(program, "radius"), backdrop->radius);
        glUniform3fv(glGetUniformLocation(program, "light"), 1, light);
        relief_bind(relief, 0, program);
        programs_set_lamps(program, s, (double)backdrop->radius);
    }
    glDepthFunc(GL_LEQUAL); /* only where nothing was drawn yet */
    glDepthMask(GL_FALSE);
    gpu_fill_screen();
    glDepthMask(GL_TRUE);
    glDepthFunc(GL_LESS);
    return TRUE;
}
