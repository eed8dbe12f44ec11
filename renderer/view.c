#include "view.h"

#include "eigenmaps_view.h"
#include "gpu.h"

#include <cglm/cglm.h>
#include <epoxy/gl.h>
#include <stddef.h>

#define WHITE       0.8 /* see exposure_ev */
#define MAX_SAMPLES (1 << 26)

const struct view_settings view_settings_default = {
    .camera_azimuth_deg = -90.0,
    .camera_elevation_deg = 35.0,
    .camera_fov_deg = 35.0,
    .light_theta_deg = 50.0,
    .light_phi_deg = 215.0,
    .ambient = 0.05,
    .samples = 1,
};

struct View {
    EigenmapsView *material;
    guint eigenmaps_program, plain_program, background_program, resolve_program;
    guint array, vertices, indices, empty_array;
    guint n_indices;
    double radius, tiles_u, tiles_v; /* of the mesh */
    struct gpu_target scene, picture;
};

gboolean view_settings_check(const struct view_settings *s, GError **error) {
    const struct {
        const char *name;
        double value, low, high;
    } ranges[] = {
        {"camera azimuth", s->camera_azimuth_deg, -1e6, 1e6},
        {"camera elevation", s->camera_elevation_deg, -90.0, 90.0},
        {"camera distance", s->camera_distance, 0.0, 1000.0},
        {"camera field of view", s->camera_fov_deg, 1.0, 120.0},
        {"light theta", s->light_theta_deg, 0.0, 180.0},
        {"light phi", s->light_phi_deg, -1e6, 1e6},
        {"tiles", s->tiles_u, 0.0, 1000.0},
        {"tiles", s->tiles_v, 0.0, 1000.0},
        {"exposure", s->exposure_ev, -20.0, 20.0},
        {"ambient", s->ambient, 0.0, 100.0},
        {"supersampling", s->samples, 1.0, 8.0},
    };
    for (gsize k = 0; k < G_N_ELEMENTS(ranges); k++)
        if (!(ranges[k].value >= ranges[k].low && ranges[k].value <= ranges[k].high)) {
            g_set_error(error, G_OPTION_ERROR, G_OPTION_ERROR_BAD_VALUE,
                        "%s is %g, but must be %g … %g", ranges[k].name, ranges[k].value,
                        ranges[k].low, ranges[k].high);
            return FALSE;
        }
    return TRUE;
}

static gboolean make_programs(View *view, GError **error) {
    const char *const eigenmaps[] = {"mesh.vert", "frame.glsl", "material.glsl", "eigenmaps.frag",
                                     NULL};
    const char *const plain[] = {"mesh.vert", "frame.glsl", "plain.frag", NULL};
    const char *const background[] = {"screen.vert", "background.frag", NULL};
    const char *const resolve[] = {"screen.vert", "resolve.frag", NULL};
    return (view->eigenmaps_program = gpu_program(eigenmaps, error)) != 0 &&
           (view->plain_program = gpu_program(plain, error)) != 0 &&
           (view->background_program = gpu_program(background, error)) != 0 &&
           (view->resolve_program = gpu_program(resolve, error)) != 0;
}

static void make_array(View *view) {
    glGenVertexArrays(1, &view->empty_array);
    glGenVertexArrays(1, &view->array);
    glGenBuffers(1, &view->vertices);
    glGenBuffers(1, &view->indices);
    glBindVertexArray(view->array);
    glBindBuffer(GL_ARRAY_BUFFER, view->vertices);
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, view->indices);
    const struct {
        int n;
        gsize offset;
    } attributes[] = {{3, offsetof(struct vertex, position)},
                      {3, offsetof(struct vertex, normal)},
                      {4, offsetof(struct vertex, tangent)},
                      {2, offsetof(struct vertex, uv)}};
    for (gsize k = 0; k < G_N_ELEMENTS(attributes); k++) {
        glEnableVertexAttribArray(k);
        glVertexAttribPointer(k, attributes[k].n, GL_FLOAT, GL_FALSE, sizeof(struct vertex),
                              (const void *)attributes[k].offset);
    }
    glBindVertexArray(0);
}

View *view_new(const struct eigenmaps *material, GError **error) {
    g_autoptr(View) view = g_new0(View, 1);
    view->radius = 1.0;
    if (!make_programs(view, error) || !view_set_material(view, material, error))
        return NULL;
    make_array(view);
    return g_steal_pointer(&view);
}

void view_free(View *view) {
    if (view == NULL)
        return;
    eigenmaps_view_free(view->material);
    const guint programs[] = {view->eigenmaps_program, view->plain_program,
                              view->background_program, view->resolve_program};
    for (gsize k = 0; k < G_N_ELEMENTS(programs); k++)
        glDeleteProgram(programs[k]);
    glDeleteVertexArrays(1, &view->array);
    glDeleteVertexArrays(1, &view->empty_array);
    glDeleteBuffers(1, &view->vertices);
    glDeleteBuffers(1, &view->indices);
    gpu_target_clear(&view->scene);
    gpu_target_clear(&view->picture);
    g_free(view);
}

gboolean view_set_material(View *view, const struct eigenmaps *material, GError **error) {
    EigenmapsView *new = eigenmaps_view_new(material, error);
    if (new == NULL)
        return FALSE;
    eigenmaps_view_free(view->material);
    view->material = new;
    return TRUE;
}

gboolean view_set_mesh(View *view, const struct mesh *mesh, GError **error) {
    glBindVertexArray(view->array);
    glBindBuffer(GL_ARRAY_BUFFER, view->vertices);
    glBufferData(GL_ARRAY_BUFFER, mesh->n_vertices * sizeof(struct vertex), mesh->vertices,
                 GL_STATIC_DRAW);
    glBufferData(GL_ELEMENT_ARRAY_BUFFER, mesh->n_indices * sizeof(guint32), mesh->indices,
                 GL_STATIC_DRAW);
    glBindVertexArray(0);
    view->n_indices = mesh->n_indices;
    view->radius = mesh->radius;
    view->tiles_u = mesh->tiles_u;
    view->tiles_v = mesh->tiles_v;
    return gpu_check("the mesh", error);
}

static void direction(double theta_deg, double phi_deg, vec3 ret) {
    double theta = theta_deg * G_PI / 180.0, phi = phi_deg * G_PI / 180.0;
    ret[0] = sin(theta) * cos(phi);
    ret[1] = sin(theta) * sin(phi);
    ret[2] = cos(theta);
}

static double distance_of(const View *view, const struct view_settings *s) {
    double fitting = 1.02 / sin(0.5 * s->camera_fov_deg * G_PI / 180.0);
    return view->radius * (s->camera_distance > 0.0 ? s->camera_distance : fitting);
}

/* The vertical axis of the picture is never along the line of sight: it leans with the elevation.
 */
static void camera(const View *view, const struct view_settings *s, double aspect, mat4 projection,
                   vec3 eye) {
    vec3 up, centre = {0.0f, 0.0f, 0.0f};
    mat4 look, lens;
    double distance = distance_of(view, s);
    direction(90.0 - s->camera_elevation_deg, s->camera_azimuth_deg, eye);
    direction(-s->camera_elevation_deg, s->camera_azimuth_deg, up);
    glm_vec3_scale(eye, distance, eye);
    glm_lookat(eye, centre, up, look);
    double half = tan(0.5 * s->camera_fov_deg * G_PI / 180.0);
    double vertical = aspect >= 1.0 ? half : half / aspect;
    double near = MAX(distance - 1.05 * view->radius, 0.01 * view->radius);
    glm_perspective(2.0 * atan(vertical), aspect, near, distance + 1.05 * view->radius, lens);
    glm_mat4_mul(lens, look, projection);
}

static void draw_background(View *view) {
    glUseProgram(view->background_program);
    glDisable(GL_DEPTH_TEST);
    glDisable(GL_BLEND);
    glDisable(GL_CULL_FACE);
    glBindVertexArray(view->empty_array);
    glDrawArrays(GL_TRIANGLES, 0, 3);
}

static void draw_mesh(View *view, const struct view_settings *s, double aspect) {
    guint program = s->plain ? view->plain_program : view->eigenmaps_program;
    vec3 eye, light;
    mat4 projection;
    camera(view, s, aspect, projection, eye);
    direction(s->light_theta_deg, s->light_phi_deg, light);
    glUseProgram(program);
    eigenmaps_view_bind(view->material, program, s->nearest);
    glUniformMatrix4fv(glGetUniformLocation(program, "projection"), 1, GL_FALSE, projection[0]);
    glUniform2f(glGetUniformLocation(program, "tiles"),
                s->tiles_u > 0.0 ? s->tiles_u : view->tiles_u,
                s->tiles_v > 0.0 ? s->tiles_v : view->tiles_v);
    glUniform3fv(glGetUniformLocation(program, "eye"), 1, eye);
    glUniform3fv(glGetUniformLocation(program, "light"), 1, light);
    glUniform1f(glGetUniformLocation(program, "ambient"), s->ambient);
    glEnable(GL_DEPTH_TEST);
    glDepthFunc(GL_LESS);
    glDepthMask(GL_TRUE);
    glBindVertexArray(view->array);
    glDrawElements(GL_TRIANGLES, view->n_indices, GL_UNSIGNED_INT, NULL);
    glBindVertexArray(0);
}

static gboolean draw_scene(View *view, const struct view_settings *s, int width, int height,
                           GError **error) {
    if (!gpu_target_resize(&view->scene, width, height, GL_RGBA16F, TRUE, error))
        return FALSE;
    glBindFramebuffer(GL_FRAMEBUFFER, view->scene.framebuffer);
    glViewport(0, 0, width, height);
    glDepthMask(GL_TRUE);
    glClear(GL_DEPTH_BUFFER_BIT);
    draw_background(view);
    draw_mesh(view, s, (double)width / height);
    return TRUE;
}

gboolean view_draw(View *view, const struct view_settings *s, guint framebuffer, int width,
                   int height, GError **error) {
    int samples = s->samples;
    while (samples > 1 && (gint64)width * height * samples * samples > MAX_SAMPLES)
        samples--;
    if (!view_settings_check(s, error) ||
        !draw_scene(view, s, width * samples, height * samples, error))
        return FALSE;
    glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
    glViewport(0, 0, width, height);
    glDisable(GL_DEPTH_TEST);
    glUseProgram(view->resolve_program);
    glActiveTexture(GL_TEXTURE0);
    glBindTexture(GL_TEXTURE_2D, view->scene.colour);
    glUniform1i(glGetUniformLocation(view->resolve_program, "drawn"), 0);
    glUniform1i(glGetUniformLocation(view->resolve_program, "samples"), samples);
    glUniform1f(glGetUniformLocation(view->resolve_program, "exposure"),
                WHITE * exp2(s->exposure_ev));
    glBindVertexArray(view->empty_array);
    glDrawArrays(GL_TRIANGLES, 0, 3);
    glBindVertexArray(0);
    return gpu_check("drawing", error);
}

static void turn_over(void *picture, gsize stride, int height) {
    g_autofree guint8 *row = g_malloc(stride);
    for (int j = 0; j < height / 2; j++) {
        guint8 *a = (guint8 *)picture + j * stride;
        guint8 *b = (guint8 *)picture + (height - 1 - j) * stride;
        memcpy(row, a, stride);
        memcpy(a, b, stride);
        memcpy(b, row, stride);
    }
}

guint8 *view_render(View *view, const struct view_settings *s, int width, int height,
                    GError **error) {
    if (!gpu_target_resize(&view->picture, width, height, GL_RGBA8, FALSE, error) ||
        !view_draw(view, s, view->picture.framebuffer, width, height, error))
        return NULL;
    g_autofree guint8 *rgb = g_malloc(3 * (gsize)width * height);
    glPixelStorei(GL_PACK_ALIGNMENT, 1);
    glReadPixels(0, 0, width, height, GL_RGB, GL_UNSIGNED_BYTE, rgb);
    if (!gpu_check("reading the picture", error))
        return NULL;
    turn_over(rgb, 3 * (gsize)width, height);
    return g_steal_pointer(&rgb);
}

float *view_render_linear(View *view, const struct view_settings *s, int width, int height,
                          GError **error) {
    if (!view_settings_check(s, error) || !draw_scene(view, s, width, height, error))
        return NULL;
    g_autofree float *rgba = g_new(float, 4 * (gsize)width * height);
    glBindFramebuffer(GL_FRAMEBUFFER, view->scene.framebuffer);
    glPixelStorei(GL_PACK_ALIGNMENT, 1);
    glReadPixels(0, 0, width, height, GL_RGBA, GL_FLOAT, rgba);
    if (!gpu_check("reading the picture", error))
        return NULL;
    turn_over(rgba, 4 * sizeof(float) * (gsize)width, height);
    return g_steal_pointer(&rgba);
}

void view_finish(void) {
    glFinish();
}
