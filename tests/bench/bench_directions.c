/*
 * Compares ways in which a shader can find the measured views around a direction: the square table
 * of reflectance fields, polynomials and eigen-maps (direction_table.h), as they use it and with
 * only the nearest cell, and cube maps (Meseth et al. 2003 §5.4). The measured directions are on
 * rings with uneven azimuths and polar angles. Each way mixes the measured directions themselves
 * with its weights. The truth is the same mix with the weights of directions_weights().
 */
#include "bench.h"
#include "bench_program.h"
#include "drawing/gl/direction_cube.h"
#include "drawing/gl/direction_table.h"
#include "drawing/methods/lobes_view.h"
#include "frame_time.h"
#include "lib/direction.h"
#include "shapes/scene.h"

#include <math.h>

#define WIDTH  800
#define HEIGHT 600
#define WAYS   3

/* Pixels are spread over the hemisphere, evenly in solid angle, as judge() has them. */
static const char head[] =
    "#version 330 core\n"
    "uniform sampler2D measured;\n"
    "uniform vec2 turn;\n"
    "out vec4 colour;\n"
    "vec3 of_pixel() {\n"
    "    vec2 p = fract(gl_FragCoord.xy / vec2(800.0, 600.0) + turn);\n"
    "    float z = 1.0 - p.y, r = sqrt(max(1.0 - z * z, 0.0)), a = 6.2831853 * p.x;\n"
    "    return vec3(r * cos(a), r * sin(a), z);\n"
    "}\n"
    "vec3 at(int k) { return texelFetch(measured, ivec2(k, 0), 0).xyz; }\n";
static const char cube[] = "uniform samplerCube view_indices, view_weights;\n"
                           "vec4 shares(vec3 d, out uvec4 index) {\n"
                           "    index = uvec4(textureLod(view_indices, d, 0.0) * 65535.0 + 0.5);\n"
                           "    return textureLod(view_weights, d, 0.0);\n"
                           "}\n";
static const char table[] = "uniform usampler2D view_indices;\n"
                            "uniform sampler2D view_weights;\n"
                            "vec4 shares(vec3 d, out uvec4 index) {\n"
                            "    return direction_shares(view_indices, view_weights, d, index);\n"
                            "}\n";
static const char nearest[] = "uniform usampler2D view_indices;\n"
                              "uniform sampler2D view_weights;\n"
                              "vec4 shares(vec3 d, out uvec4 index) {\n"
                              "    ivec2 n = textureSize(view_indices, 0);\n"
                              "    ivec2 cell = min(ivec2(square(d) * vec2(n)), n - 1);\n"
                              "    index = texelFetch(view_indices, cell, 0);\n"
                              "    return texelFetch(view_weights, cell, 0);\n"
                              "}\n";
static const char tail[] =
    "void main() {\n"
    "    uvec4 k;\n"
    "    vec4 w = shares(of_pixel(), k);\n"
    "    colour = vec4(w.x * at(int(k.x)) + w.y * at(int(k.y)) + w.z * at(int(k.z)) +\n"
    "                  w.w * at(int(k.w)), 1.0);\n"
    "}\n";

static GLuint make_program(const char *way) {
    const char *const vertex[] = {"#version 330 core\n", bench_text_of("screen.vert"), NULL};
    const char *const fragment[] = {head, bench_text_of("directions.glsl"), way, tail, NULL};
    return bench_program(vertex, fragment);
}

struct rings {
    float theta_deg[200], phi_deg[200];
    struct vec3 measured[201]; /* the last is the pole */
    int n;
    Directions *directions;
};

/* As a rig has them that was set by hand: 9 to 24 azimuths a ring, unevenly. */
static gboolean make_rings(struct rings *r, GError **error) {
    static const double polar[] = {11, 26, 37, 52, 61, 75};
    static const int around[] = {9, 12, 14, 18, 20, 24};
    GRand *random = g_rand_new_with_seed(2);
    int n_pole;
    r->n = 0;
    for (int k = 0; k < 6; k++)
        for (int i = 0; i < around[k]; i++, r->n++) {
            r->theta_deg[r->n] = (float)(polar[k] + g_rand_double_range(random, -0.8, 0.8));
            r->phi_deg[r->n] =
                (float)(360.0 / around[k] * (i + g_rand_double_range(random, -0.3, 0.3)) + 360);
        }
    g_rand_free(random);
    r->directions = directions_new(r->theta_deg, r->phi_deg, r->n, error);
    if (r->directions == NULL)
        return FALSE;
    const int *pole = directions_pole(r->directions, &n_pole);
    for (int k = 0; k < r->n; k++)
        r->measured[k] = direction_of_deg((double)r->theta_deg[k], (double)r->phi_deg[k]);
    r->measured[r->n] = vec3(0, 0, 0);
    for (int k = 0; k < n_pole; k++)
        r->measured[r->n] =
            vec3_add(r->measured[r->n], vec3_scale(r->measured[pole[k]], 1.0 / n_pole));
    return TRUE;
}

struct way {
    const char *name;
    GLuint program;
    struct direction_textures textures;
    double ms, rms, worst;
};

static void draw(const struct way *way, guint measured, double turn) {
    glUseProgram(way->program);
    glActiveTexture(GL_TEXTURE2);
    glBindTexture(GL_TEXTURE_2D, measured);
    glUniform1i(glGetUniformLocation(way->program, "measured"), 2);
    glUniform2f(glGetUniformLocation(way->program, "turn"), (float)turn, (float)turn);
    direction_textures_bind(&way->textures, way->program, "view", 0);
    glDrawArrays(GL_TRIANGLES, 0, 3);
    glFinish();
}

/* At the pixels' centres, turn being 0. */
static void judge(struct way *way, const struct rings *r, guint measured) {
    g_autofree float *shown = g_new(float, 4 * WIDTH * HEIGHT);
    double sum = 0;
    draw(way, measured, 0);
    glReadPixels(0, 0, WIDTH, HEIGHT, GL_RGBA, GL_FLOAT, shown);
    for (int k = 0; k < WIDTH * HEIGHT; k++) {
        const int row = k / WIDTH, column = k % WIDTH;
        const double z = 1 - (row + 0.5) / HEIGHT, a = 2 * G_PI * (column + 0.5) / WIDTH;
        const double size = sqrt(1 - z * z);
        const struct vec3 d = {size * cos(a), size * sin(a), z};
        struct direction_weights w;
        struct vec3 mixed = {0, 0, 0};
        directions_weights(r->directions, d, &w);
        for (int i = 0; i < 4; i++)
            mixed = vec3_add(mixed, vec3_scale(r->measured[w.index[i]], (double)w.weight[i]));
        const struct vec3 found = {shown[4 * k], shown[4 * k + 1], shown[4 * k + 2]};
        const double off = vec3_length(vec3_sub(found, mixed));
        sum += off * off;
        way->worst = fmax(way->worst, off);
    }
    way->rms = sqrt(sum / (WIDTH * HEIGHT));
}

/* A whole picture of reflectance fields of two lobes on a torus, to compare that with. */
static gboolean time_fields(const struct rings *r, int frames, double *ret_ms, GError **error) {
    GRand *random = g_rand_new_with_seed(5);
    struct lobes fields = {.model = LOBES_FIELDS,
                           .layout.width = 16,
                           .layout.height = 16,
                           .layout.texel_mm = 1,
                           .layout.views.n = r->n,
                           .layout.views.theta_deg = (float *)r->theta_deg,
                           .layout.views.phi_deg = (float *)r->phi_deg,
                           .n_lobes = 2,
                           .n_slices = r->n,
                           .n_values = 11};
    struct lobes *levels[1] = {&fields};
    const gsize n = (gsize)r->n * 16 * 16 * 11;
    fields.values = g_new(float, n);
    for (gsize k = 0; k < n; k++)
        fields.values[k] = (float)g_rand_double_range(random, 0.2, 0.7);
    g_rand_free(random);
    g_autoptr(Viewer) viewer = viewer_new(NULL, error);
    struct mesh *mesh = scene_torus(1, 0.4, 192, 96);
    const struct viewer_settings settings = viewer_settings_default;
    LobesView *shown = viewer ? lobes_view_new(levels, 1, error) : NULL;
    const gboolean good = shown && viewer_set_method(viewer, &methods_lobes[0], shown, error) &&
                          viewer_set_mesh(viewer, mesh, error) &&
                          time_in_turns(&viewer, &settings, 1, frames, ret_ms, NULL, error);
    mesh_free(mesh);
    g_free(fields.values);
    return good;
}

static gboolean bench(int frames, GError **error) {
    g_autoptr(Gpu) gpu = gpu_new_headless(error);
    static struct rings rings;
    struct gpu_target target = {0};
    if (gpu == NULL || !make_rings(&rings, error) ||
        !gpu_target_resize(&target, WIDTH, HEIGHT, GL_RGBA32F, FALSE, error))
        return FALSE;
    GLuint array;
    glGenVertexArrays(1, &array);
    glBindVertexArray(array);
    glBindFramebuffer(GL_FRAMEBUFFER, target.framebuffer);
    glViewport(0, 0, WIDTH, HEIGHT);
    struct way ways[WAYS] = {
        {"square table", make_program(table), direction_table_new(rings.directions, FALSE)},
        {"the same, nearest cell", make_program(nearest),
         direction_table_new(rings.directions, FALSE)},
        {"cube maps", make_program(cube), direction_cube_new(rings.directions, FALSE)}};
    float rgba[4 * 201] = {0};
    for (int k = 0; k <= rings.n; k++) {
        rgba[4 * k] = (float)rings.measured[k].x;
        rgba[4 * k + 1] = (float)rings.measured[k].y;
        rgba[4 * k + 2] = (float)rings.measured[k].z;
    }
    const guint measured = gpu_texture(GL_RGBA32F, rings.n + 1, 1, 0);
    glTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, rings.n + 1, 1, GL_RGBA, GL_FLOAT, rgba);
    for (int k = 0; k < WAYS; k++)
        judge(&ways[k], &rings, measured);
    g_autofree double *times = g_new(double, WAYS *(gsize)frames);
    for (int k = 0; k < frames; k++)
        for (int way = 0; way < WAYS; way++) {
            const double start = now_us();
            draw(&ways[way], measured, 0.013 * k);
            times[way * frames + k] = (now_us() - start) * 1e-3;
        }
    for (int way = 0; way < WAYS; way++)
        ways[way].ms = bench_time_quantile(times + (gsize)way * frames, frames, 0.5);
    bench_put("%s{renderer} %d{directions}", gpu_renderer(), rings.n);
    bench_begin_list("ways");
    for (int k = 0; k < WAYS; k++)
        bench_row(NULL, "%-24s{way} %.6f{rms} %.6f{worst} %.2f{ms} %" G_GINT64_FORMAT "{bytes}",
                  ways[k].name, ways[k].rms, ways[k].worst, ways[k].ms,
                  direction_textures_bytes(&ways[k].textures));
    bench_end();
    double ms = 0;
    const gboolean good = gpu_check("the bench", error) && time_fields(&rings, frames, &ms, error);
    bench_put("%.2f{fields_ms}", ms); /* a torus of reflectance fields */
    directions_free(rings.directions);
    return good;
}

int main(int argc, char **argv) {
    int frames = 15;
    const GOptionEntry entries[] = {
        {"frames", 0, 0, G_OPTION_ARG_INT, &frames, "Timed frames of each, default 15", "N"},
        {NULL}};
    g_autoptr(GError) error = NULL;
    bench_parse(&argc, &argv, entries, NULL);
    if (frames < 1 || argc > 1)
        bench_fail(2, "bad arguments");
    bench_begin(NULL);
    bench(frames, &error);
    bench_end();
    bench_check(error);
    return 0;
}
