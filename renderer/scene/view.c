#include "view.h"

#include "backdrop.h"
#include "base/direction.h"
#include "camera.h"
#include "gl/gpu.h"
#include "hatching.h"
#include "methods/eigenmaps_view.h"
#include "programs.h"
#include "relief/relief.h"
#include "shapes/mesh_shape.h"

#include <epoxy/gl.h>
#include <math.h>
#include <stddef.h>
#include <string.h>

#define WHITE       0.8 /* see exposure_ev */
#define MAX_SAMPLES (1 << 26)

const struct view_settings view_settings_default = {
    .camera_azimuth_deg = -90.0,
    .camera_elevation_deg = 40.0,
    .camera_fov_deg = 30.0,
    .light_theta_deg = 50.0,
    .light_phi_deg = 200.0,
    .exposure_ev = 0.7,
    .ambient = 0.05,
    .lamp = 1.0,
    .samples = 1,
    .visibility = {.layers = VISIBILITY_MAX_LAYERS},
    .shadow_size = 1024,
};

struct View {
    const struct method *method;
    gpointer material;  /* of the method */
    Programs *programs; /* of the method */
    Relief *relief;
    Backdrop *backdrop;
    Hatching *hatching;
    guint plain_program, geometry_program, resolve_program;
    guint array, vertices, shapes, indices, empty_array;
    guint n_indices, n_casting, serial;
    double radius, tiles_u, tiles_v; /* of the mesh */
    double reach;                    /* of the mesh and its floor */
    float *points;                   /* n_points × 3 */
    guint n_points;
    struct gpu_target scene, geometry, picture;
};

gboolean view_settings_check(const struct view_settings *s, GError **error) {
    const struct {
        const char *name;
        double value, low, high;
    } ranges[] = {
        {"camera azimuth", s->camera_azimuth_deg, -1e6, 1e6},
        {"camera elevation", s->camera_elevation_deg, -90.0, 90.0},
        {"camera distance", s->camera_distance, 0.0, 1000.0},
        {"camera pan", s->camera_pan[0], -1000.0, 1000.0},
        {"camera pan", s->camera_pan[1], -1000.0, 1000.0},
        {"camera field of view", s->camera_fov_deg, 1.0, 120.0},
        {"light theta", s->light_theta_deg, 0.0, 180.0},
        {"light phi", s->light_phi_deg, -1e6, 1e6},
        {"tiles", s->tiles_u, 0.0, 1000.0},
        {"tiles", s->tiles_v, 0.0, 1000.0},
        {"exposure", s->exposure_ev, -20.0, 20.0},
        {"ambient", s->ambient, 0.0, 100.0},
        {"lamp", s->lamp, 0.0, 100.0},
        {"lamps", s->n_lamps, 0.0, VIEW_MAX_LAMPS},
        {"supersampling", s->samples, 1.0, 8.0},
        {"layers", s->visibility.layers, 1.0, VISIBILITY_MAX_LAYERS},
        {"shadow map", s->shadow_size, 16.0, 16384.0},
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

double view_exposure(const struct view_settings *s) {
    return WHITE * exp2(s->exposure_ev);
}

static gboolean view_make_programs(View *view, GError **error) {
    const char *const plain[] = {"mesh.vert", "frame.glsl", "plain.frag", NULL};
    const char *const geometry[] = {"mesh.vert",   "frame.glsl",    "visible.glsl",
                                    "shadow.glsl", "geometry.frag", NULL};
    const char *const resolve[] = {"screen.vert", "resolve.frag", NULL};
    return (view->plain_program = gpu_program(plain, error)) != 0 &&
           (view->geometry_program = gpu_program(geometry, error)) != 0 &&
           (view->resolve_program = gpu_program(resolve, error)) != 0;
}

static void make_array(View *view) {
    glGenVertexArrays(1, &view->empty_array);
    glGenVertexArrays(1, &view->array);
    glGenBuffers(1, &view->vertices);
    glGenBuffers(1, &view->shapes);
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
    const guint n = G_N_ELEMENTS(attributes);
    for (guint k = 0; k < n; k++)
        glVertexAttribPointer(k, attributes[k].n, GL_FLOAT, GL_FALSE, sizeof(struct vertex),
                              (const void *)attributes[k].offset);
    glBindBuffer(GL_ARRAY_BUFFER, view->shapes);
    glVertexAttribPointer(n, 2, GL_FLOAT, GL_FALSE, sizeof(struct vertex_shape), NULL);
    glVertexAttribPointer(n + 1, 3, GL_FLOAT, GL_FALSE, sizeof(struct vertex_shape),
                          (const void *)offsetof(struct vertex_shape, bend));
    for (guint k = 0; k < n + 2; k++)
        glEnableVertexAttribArray(k);
    glBindVertexArray(0);
}

View *view_new(const struct eigenmaps *material, GError **error) {
    g_autoptr(View) view = g_new0(View, 1);
    view->radius = view->reach = 1.0;
    if (!view_make_programs(view, error) || (view->relief = relief_new(error)) == NULL ||
        (view->backdrop = backdrop_new(error)) == NULL ||
        (view->hatching = hatching_new(error)) == NULL ||
        (material != NULL && !view_set_material(view, material, error)))
        return NULL;
    make_array(view);
    return g_steal_pointer(&view);
}

void view_free(View *view) {
    if (view == NULL)
        return;
    if (view->method != NULL)
        view->method->free(view->material);
    programs_free(view->programs);
    relief_free(view->relief);
    backdrop_free(view->backdrop);
    hatching_free(view->hatching);
    const guint programs[] = {view->plain_program, view->geometry_program, view->resolve_program};
    for (gsize k = 0; k < G_N_ELEMENTS(programs); k++)
        glDeleteProgram(programs[k]);
    glDeleteVertexArrays(1, &view->array);
    glDeleteVertexArrays(1, &view->empty_array);
    glDeleteBuffers(1, &view->vertices);
    glDeleteBuffers(1, &view->shapes);
    glDeleteBuffers(1, &view->indices);
    gpu_target_clear(&view->scene);
    gpu_target_clear(&view->geometry);
    gpu_target_clear(&view->picture);
    g_free(view->points);
    g_free(view);
}

gboolean view_set_method(View *view, const struct method *method, gpointer material,
                         GError **error) {
    if (view->method != method) {
        g_autoptr(Programs) programs = programs_new(method);
        if (!programs_get(programs, PROGRAM_SURFACE, material, &view_settings_default, error))
            return FALSE;
        programs_free(view->programs);
        view->programs = g_steal_pointer(&programs);
    }
    if (view->method != NULL)
        view->method->free(view->material);
    view->method = method;
    view->material = material;
    return TRUE;
}

gboolean view_open(View *view, const struct method *method, const char *path, GError **error) {
    gpointer material = method_open(method, path, error);
    if (material == NULL)
        return FALSE;
    if (view_set_method(view, method, material, error))
        return TRUE;
    method->free(material);
    return FALSE;
}

gboolean view_set_material(View *view, const struct eigenmaps *material, GError **error) {
    EigenmapsView *new = eigenmaps_view_new(material, error);
    if (new == NULL)
        return FALSE;
    if (view_set_method(view, &method_eigenmaps, new, error))
        return TRUE;
    eigenmaps_view_free(new);
    return FALSE;
}

static void keep_points(View *view, const struct mesh *mesh) {
    g_free(view->points);
    view->n_points = mesh->n_vertices - mesh->n_floor_vertices;
    view->points = g_new(float, 3 * (gsize)view->n_points);
    for (guint k = 0; k < view->n_points; k++)
        memcpy(view->points + 3 * (gsize)k, mesh->vertices[k].position, 3 * sizeof(float));
    backdrop_set_points(view->backdrop, view->points, view->n_points, view->radius);
}

gboolean view_set_mdf(View *view, const struct mdf_source *mdf, GError **error) {
    return relief_set_mdf(view->relief, mdf, error);
}

gboolean view_open_mdf(View *view, const char *path, GError **error) {
    struct mdf_source *mdf = mdf_source_read(path, error);
    gboolean good = mdf != NULL && view_set_mdf(view, mdf, error);
    if (mdf != NULL && !good)
        g_prefix_error(error, "%s: ", path);
    mdf_source_free(mdf);
    return good;
}

gboolean view_set_environment(View *view, const struct environment *environment, GError **error) {
    return backdrop_set_environment(view->backdrop, environment, error);
}

struct view_memory view_memory(const View *view) {
    return (struct view_memory){view->method ? view->method->bytes(view->material) : 0,
                                relief_mdf_bytes(view->relief)};
}

static void upload_shapes(const View *view, const struct mesh *mesh) {
    g_autofree struct vertex_shape *shapes = mesh_shapes(mesh);
    glBindBuffer(GL_ARRAY_BUFFER, view->shapes);
    glBufferData(GL_ARRAY_BUFFER, mesh->n_vertices * sizeof(struct vertex_shape), shapes,
                 GL_STATIC_DRAW);
}

static double length(const float p[3]) {
    return sqrtf(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
}

gboolean view_set_mesh(View *view, const struct mesh *mesh, GError **error) {
    glBindVertexArray(view->array);
    glBindBuffer(GL_ARRAY_BUFFER, view->vertices);
    glBufferData(GL_ARRAY_BUFFER, mesh->n_vertices * sizeof(struct vertex), mesh->vertices,
                 GL_STATIC_DRAW);
    glBufferData(GL_ELEMENT_ARRAY_BUFFER, mesh->n_indices * sizeof(guint32), mesh->indices,
                 GL_STATIC_DRAW);
    upload_shapes(view, mesh);
    glBindVertexArray(0);
    view->serial++;
    view->n_indices = mesh->n_indices;
    view->n_casting = mesh->n_indices - mesh->n_floor_indices;
    view->radius = view->reach = mesh->radius;
    for (guint k = mesh->n_vertices - mesh->n_floor_vertices; k < mesh->n_vertices; k++)
        view->reach = MAX(view->reach, length(mesh->vertices[k].position));
    view->tiles_u = mesh->tiles_u;
    view->tiles_v = mesh->tiles_v;
    keep_points(view, mesh);
    return gpu_check("the mesh", error);
}

void view_fit(const View *view, struct view_settings *settings, double aspect) {
    if (settings->camera_distance == 0.0 && view->n_points > 0)
        camera_fit(settings, view->points, view->n_points, view->radius, aspect);
}

/* What mesh.vert knows of camera and lamp. */
struct sight {
    float projection[16], eye[3], light[3], tiles[2];
};

static void view_draw_mesh(View *view, guint program, const struct view_settings *s,
                           const struct sight *sight) {
    glUseProgram(program);
    view->method->bind(view->material, program, &s->style);
    relief_bind(view->relief, program);
    glUniformMatrix4fv(glGetUniformLocation(program, "projection"), 1, GL_FALSE, sight->projection);
    glUniform2fv(glGetUniformLocation(program, "tiles"), 1, sight->tiles);
    glUniform3fv(glGetUniformLocation(program, "eye"), 1, sight->eye);
    glUniform3fv(glGetUniformLocation(program, "light"), 1, sight->light);
    glUniform1f(glGetUniformLocation(program, "ambient_light"), s->ambient);
    programs_set_lamps(program, s);
    glDisable(GL_BLEND);
    glDisable(GL_CULL_FACE);
    glEnable(GL_DEPTH_TEST);
    glDepthFunc(GL_LESS);
    glDepthMask(GL_TRUE);
    glBindVertexArray(view->array);
    glDrawElements(GL_TRIANGLES, view->n_indices, GL_UNSIGNED_INT, NULL);
    glBindVertexArray(0);
}

/* Looks, and finds what is seen and lit of the relief. */
static gboolean view_look(const View *view, const struct view_settings *s, int width, int height,
                          struct sight *ret, GError **error) {
    struct view_settings fitted = *s;
    double aspect = (double)width / height;
    view_fit(view, &fitted, aspect);
    camera_matrix(&fitted, view->radius, view->reach, aspect, ret->projection, ret->eye);
    direction_from_deg(s->light_theta_deg, s->light_phi_deg, ret->light);
    ret->tiles[0] = s->tiles_u > 0.0 ? s->tiles_u : view->tiles_u;
    ret->tiles[1] = s->tiles_v > 0.0 ? s->tiles_v : view->tiles_v;
    struct relief_scene scene = {.array = view->array,
                                 .n_indices = view->n_indices,
                                 .n_casting = view->n_casting,
                                 .radius = view->radius,
                                 .width = width,
                                 .height = height,
                                 .serial = view->serial,
                                 .silhouettes = s->silhouettes,
                                 .shadows = s->shadows,
                                 .lit = s->lamp > 0.0,
                                 .n_further = s->n_lamps,
                                 .shadow_size = s->shadow_size,
                                 .visibility = s->visibility};
    for (int k = 0; k < s->n_lamps; k++)
        direction_from_deg(s->lamps[k].theta_deg, s->lamps[k].phi_deg, scene.further[k]);
    memcpy(scene.projection, ret->projection, sizeof scene.projection);
    memcpy(scene.eye, ret->eye, sizeof scene.eye);
    memcpy(scene.light, ret->light, sizeof scene.light);
    memcpy(scene.tiles, ret->tiles, sizeof scene.tiles);
    return relief_prepare(view->relief, &scene, error);
}

static void view_begin(const struct gpu_target *target) {
    glBindFramebuffer(GL_FRAMEBUFFER, target->framebuffer);
    glViewport(0, 0, target->width, target->height);
    glDepthMask(GL_TRUE);
    glClearColor(0.0f, 0.0f, 0.0f, 0.0f);
    glClear(GL_DEPTH_BUFFER_BIT | GL_COLOR_BUFFER_BIT);
}

static gboolean view_draw_scene(View *view, const struct view_settings *s, int width, int height,
                                GError **error) {
    const enum program_kind kind = s->silhouettes || s->shadows ? PROGRAM_RELIEF : PROGRAM_SURFACE;
    const guint program = s->plain ? view->plain_program
                                   : programs_get(view->programs, kind, view->material, s, error);
    struct sight sight;
    if (program == 0 || !gpu_target_resize(&view->scene, width, height, GL_RGBA16F, TRUE, error) ||
        !view_look(view, s, width, height, &sight, error))
        return FALSE;
    view_begin(&view->scene);
    view_draw_mesh(view, program, s, &sight);
    return backdrop_draw(view->backdrop, s, view->relief, sight.projection, sight.eye, error);
}

static void resolve(View *view, const struct view_settings *s, int samples, guint framebuffer,
                    int width, int height) {
    guint program = view->resolve_program;
    glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
    glViewport(0, 0, width, height);
    glDisable(GL_DEPTH_TEST);
    glUseProgram(program);
    gpu_bind_texture(program, "drawn", 0, GL_TEXTURE_2D, view->scene.colour);
    glUniform1i(glGetUniformLocation(program, "samples"), samples);
    glUniform1f(glGetUniformLocation(program, "exposure"), (float)view_exposure(s));
    glBindVertexArray(view->empty_array);
    glDrawArrays(GL_TRIANGLES, 0, 3);
    glBindVertexArray(0);
}

static gboolean draw_geometry(View *view, const struct view_settings *s, enum view_geometry which,
                              int width, int height, GError **error) {
    struct sight sight;
    if (!gpu_target_resize(&view->geometry, width, height, GL_RGBA32F, TRUE, error) ||
        !view_look(view, s, width, height, &sight, error))
        return FALSE;
    view_begin(&view->geometry);
    glDisable(GL_BLEND);
    glDisable(GL_CULL_FACE);
    glUseProgram(view->geometry_program);
    glUniform1i(glGetUniformLocation(view->geometry_program, "which"), which);
    view_draw_mesh(view, view->geometry_program, s, &sight);
    return TRUE;
}

void view_set_planned(View *view, const struct planned_view *views, guint n) {
    hatching_set(view->hatching, views, n);
}

static gboolean draw_hatching(View *view, const struct view_settings *s, guint framebuffer,
                              int width, int height, GError **error) {
    if (!hatching_any(view->hatching))
        return TRUE;
    if (!draw_geometry(view, s, VIEW_GEOMETRY_VIEW, width, height, error))
        return FALSE;
    hatching_draw(view->hatching, view->geometry.colour, framebuffer, width, height);
    return TRUE;
}

/* Each way of a pixel: fewer in a very large picture. */
static int view_samples_of(const struct view_settings *s, int width, int height) {
    int samples = s->samples;
    while (samples > 1 && (gint64)width * height * samples * samples > MAX_SAMPLES)
        samples--;
    return samples;
}

gboolean view_draw(View *view, const struct view_settings *s, guint framebuffer, int width,
                   int height, GError **error) {
    const int samples = view_samples_of(s, width, height);
    if (!view_settings_check(s, error) ||
        !view_draw_scene(view, s, width * samples, height * samples, error))
        return FALSE;
    resolve(view, s, samples, framebuffer, width, height);
    return draw_hatching(view, s, framebuffer, width, height, error) && gpu_check("drawing", error);
}

static float *read_floats(const struct gpu_target *target, GError **error) {
    g_autofree float *rgba = g_new(float, 4 * (gsize)target->width * target->height);
    glBindFramebuffer(GL_FRAMEBUFFER, target->framebuffer);
    glPixelStorei(GL_PACK_ALIGNMENT, 1);
    glReadPixels(0, 0, target->width, target->height, GL_RGBA, GL_FLOAT, rgba);
    if (!gpu_check("reading the picture", error))
        return NULL;
    gpu_turn_over(rgba, 4 * sizeof(float) * (gsize)target->width, target->height);
    return g_steal_pointer(&rgba);
}

guint8 *view_render(View *view, const struct view_settings *s, int width, int height,
                    GError **error) {
    if (!gpu_target_resize(&view->picture, width, height, GL_RGBA8, FALSE, error) ||
        !view_draw(view, s, view->picture.framebuffer, width, height, error))
        return NULL;
    return gpu_target_read(&view->picture, error);
}

float *view_render_linear(View *view, const struct view_settings *s, int width, int height,
                          GError **error) {
    if (!view_settings_check(s, error) || !view_draw_scene(view, s, width, height, error))
        return NULL;
    return read_floats(&view->scene, error);
}

float *view_render_light(View *view, const struct view_settings *s, int width, int height,
                         GError **error) {
    const int samples = view_samples_of(s, width, height);
    g_autofree float *drawn = view_render_linear(view, s, width * samples, height * samples, error);
    if (drawn == NULL)
        return NULL;
    const float share = 1.0F / (float)(samples * samples), exposure = (float)view_exposure(s);
    float *light = g_new0(float, 3 * (gsize)width * height);
    for (gsize j = 0; j < (gsize)height * samples; j++)
        for (gsize i = 0; i < (gsize)width * samples; i++) {
            const float *from = drawn + 4 * (j * width * samples + i);
            float *to = light + 3 * (j / samples * width + i / samples);
            for (int c = 0; c < 3; c++)
                to[c] += from[c] * share * (from[3] > 0.5F ? exposure : 1);
        }
    return light;
}

float *view_render_geometry(View *view, const struct view_settings *s, enum view_geometry which,
                            int width, int height, GError **error) {
    if (!view_settings_check(s, error) || !draw_geometry(view, s, which, width, height, error))
        return NULL;
    return read_floats(&view->geometry, error);
}

float *view_render_flat(View *view, const struct view_settings *s, const float to_view[3],
                        const float to_light[3], int width, int height, GError **error) {
    struct view_settings alone = *s;
    alone.ambient = 0;
    const guint program = programs_get(view->programs, PROGRAM_FLAT, view->material, &alone, error);
    if (program == 0 || !gpu_target_resize(&view->geometry, width, height, GL_RGBA32F, TRUE, error))
        return NULL;
    view_begin(&view->geometry);
    glDisable(GL_BLEND);
    glDisable(GL_DEPTH_TEST);
    glUseProgram(program);
    view->method->bind(view->material, program, &s->style);
    glUniform3fv(glGetUniformLocation(program, "to_view"), 1, to_view);
    glUniform3fv(glGetUniformLocation(program, "to_light"), 1, to_light);
    glBindVertexArray(view->empty_array);
    glDrawArrays(GL_TRIANGLES, 0, 3);
    glBindVertexArray(0);
    return read_floats(&view->geometry, error);
}

guint8 *view_resolve(View *view, const struct view_settings *s, const float *linear, int width,
                     int height, GError **error) {
    int w = width * s->samples, h = height * s->samples;
    if (!view_settings_check(s, error) ||
        !gpu_target_resize(&view->scene, w, h, GL_RGBA16F, TRUE, error) ||
        !gpu_target_resize(&view->picture, width, height, GL_RGBA8, FALSE, error))
        return NULL;
    g_autofree float *rows = g_memdup2(linear, 4 * sizeof(float) * (gsize)w * h);
    gpu_turn_over(rows, 4 * sizeof(float) * (gsize)w, h);
    glActiveTexture(GL_TEXTURE0);
    glBindTexture(GL_TEXTURE_2D, view->scene.colour);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    glTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, w, h, GL_RGBA, GL_FLOAT, rows);
    resolve(view, s, s->samples, view->picture.framebuffer, width, height);
    return gpu_target_read(&view->picture, error);
}

void view_finish(void) {
    glFinish();
}
