#include "microfacet_parts.h"

#include "base/direction.h"
#include "bench.h"
#include "bench_program.h"
#include "drawing/methods/microfacet.h"
#include "frame_time.h"
#include "scene/camera.h"
#include "scene/viewer.h"
#include "shapes/scene.h"

#include <math.h>

#define WIDTH   800
#define HEIGHT  600
#define MAP     256 /* texels of the normal map, each way */
#define REPEATS 32  /* rotations of a pixel, where they are timed only */

/* Per vertex: a diffuser with a Blinn–Phong highlight. */
static const char gouraud_vertex[] =
    "layout(location = 0) in vec3 position;\n"
    "layout(location = 1) in vec3 normal;\n"
    "uniform mat4 projection;\n"
    "uniform vec3 eye, light, diffuse, specular;\n"
    "out vec3 shaded;\n"
    "void main() {\n"
    "    vec3 h = normalize(light + normalize(eye - position));\n"
    "    float nl = max(dot(normal, light), 0.0);\n"
    "    shaded = nl * (diffuse + specular * pow(max(dot(normal, h), 0.0), 40.0));\n"
    "    gl_Position = projection * vec4(position, 1.0);\n"
    "}\n";
static const char gouraud_fragment[] = "in vec3 shaded;\n"
                                       "out vec4 colour;\n"
                                       "void main() {\n"
                                       "    colour = vec4(shaded, 1.0);\n"
                                       "}\n";
/* WAY: 0 … 2 as enum method_rotation, 3 by a matrix (Kang & Cho 2011 eq. 4 … 6), 4 without a normal
 * map. */
static const char surface_fragment[] =
    "uniform sampler2D normals;\n"
    "uniform vec3 diffuse, specular;\n"
    "uniform vec2 rough;\n"
    "vec4 facet_by_matrix(vec3 h, vec3 n) {\n"
    "    vec3 side = cross(vec3(0.0, 1.0, 0.0), n), up = normalize(cross(n, side));\n"
    "    vec3 p = transpose(mat3(normalize(cross(up, n)), up, n)) * h;\n"
    "    return vec4(p.xy * p.xy, p.z, 1.0);\n"
    "}\n"
    "vec3 reflected(vec3 n, vec3 v, vec3 l) {\n"
    "    float nl = dot(n, l);\n"
    "    if (nl <= 1e-4)\n"
    "        return vec3(0.0);\n"
    "    vec3 h = (l + v) / max(length(l + v), 1e-3);\n"
    "    vec4 half_v = WAY == 3 ? facet_by_matrix(h, n) : facet_half(h, n, WAY == 4 ? 2 : WAY);\n"
    "    return diffuse * nl + specular * facet_shine(rough, half_v, nl, dot(n, v), dot(h, l));\n"
    "}\n"
    "void main() {\n"
    "    mat3 frame = local_frame();\n"
    "    vec3 n = vec3(0.0, 0.0, 1.0);\n"
    "#if WAY != 4\n"
    "    n.xy = texture(normals, texel).xy;\n"
    "    n.z = sqrt(max(1.0 - dot(n.xy, n.xy), 0.0));\n"
    "#endif\n"
    "    colour = vec4(reflected(n, frame * normalize(eye - world), frame * light), 1.0);\n"
    "}\n";
/* Normals and half vectors change from one rotation to the next, so that none is left out. */
static const char alone_fragment[] =
    "uniform vec2 turn;\n"
    "out vec4 colour;\n"
    "vec3 turned(vec3 h, vec3 n) {\n"
    "#if WAY == 2\n"
    "    return vec3(h.xy, dot(n, h));\n"
    "#elif WAY == 1\n"
    "    return vec3(n.z * h.x - n.x * h.z, h.y - n.y * dot(n, h), dot(n, h));\n"
    "#elif WAY == 0\n"
    "    vec2 p = vec2(n.z * h.x - n.x * h.z, h.y - n.y * dot(n, h));\n"
    "    return vec3(p * inversesqrt(1.0000001 - n.y * n.y), dot(n, h));\n"
    "#else\n"
    "    vec3 side = cross(vec3(0.0, 1.0, 0.0), n), up = normalize(cross(n, side));\n"
    "    return transpose(mat3(normalize(cross(up, n)), up, n)) * h;\n"
    "#endif\n"
    "}\n"
    "void main() {\n"
    "    vec2 p = fract(gl_FragCoord.xy / vec2(800.0, 600.0) + turn) - 0.5, q = p.yx;\n"
    "    vec3 sum = vec3(0.0);\n"
    "    for (int k = 0; k < REPEATS; k++) {\n"
    "        p = vec2(0.8 * p.x - 0.6 * p.y, 0.6 * p.x + 0.8 * p.y);\n"
    "        q = vec2(0.6 * q.x - 0.8 * q.y, 0.8 * q.x + 0.6 * q.y);\n"
    "        sum += turned(vec3(q, sqrt(1.0 - dot(q, q))), vec3(p, sqrt(1.0 - dot(p, p))));\n"
    "    }\n"
    "    colour = vec4(sum / float(REPEATS), 1.0);\n"
    "}\n";

enum { GOURAUD, ANISOTROPIC, NAIVE, APPROXIMATE, EXACT, MATRIX, N_TIMED };

static const struct {
    const char *key;
    int way;
} timed[N_TIMED] = {
    {"gouraud", -1},                 /* shading at the vertices */
    {"anisotropic", 4},              /* without a normal map */
    {"naive", METHOD_ROTATION_NONE}, /* plain normal mapping */
    {"approximate", METHOD_ROTATION_APPROXIMATE},
    {"exact", METHOD_ROTATION_EXACT},
    {"matrix", 3}, /* the exact rotation by a matrix */
};

static GLuint microfacet_times_program(enum microfacet_model model, int way) {
    const char *const version = "#version 330 core\n";
    g_autofree char *constants = g_strdup_printf("#define WAY %d\n", way);
    if (way < 0) {
        const char *const vertex[] = {version, gouraud_vertex, NULL};
        const char *const fragment[] = {version, gouraud_fragment, NULL};
        return bench_program(vertex, fragment);
    }
    const char *const vertex[] = {version, bench_text_of("mesh.vert"), NULL};
    const char *const fragment[] = {
        version,
        constants,
        bench_text_of("frame.glsl"),
        bench_text_of(model == MICROFACET_WARD ? "ward.glsl" : "ashikhmin.glsl"),
        bench_text_of("microfacet.glsl"),
        surface_fragment,
        NULL};
    return bench_program(vertex, fragment);
}

static GLuint microfacet_times_alone(int way) {
    g_autofree char *constants =
        g_strdup_printf("#define WAY %d\n#define REPEATS %d\n", way, REPEATS);
    const char *const vertex[] = {"#version 330 core\n", bench_text_of("screen.vert"), NULL};
    const char *const fragment[] = {"#version 330 core\n", constants, alone_fragment, NULL};
    return bench_program(vertex, fragment);
}

/* The metal's own bosses, as microfacet_view.c has them. */
static guint microfacet_times_normals(void) {
    g_autofree float *xy = g_new(float, 2 * MAP * MAP);
    struct microfacet surface;
    struct vec3 n;
    for (int j = 0; j < MAP; j++)
        for (int i = 0; i < MAP; i++) {
            const double at[2] = {(i + 0.5) / MAP, (j + 0.5) / MAP};
            microfacet_surface_at(MICROFACET_METAL, MICROFACET_WARD, at, &surface, &n);
            xy[2 * (j * MAP + i)] = (float)n.x;
            xy[2 * (j * MAP + i) + 1] = (float)n.y;
        }
    GLuint texture;
    glGenTextures(1, &texture);
    glBindTexture(GL_TEXTURE_2D, texture);
    glTexImage2D(GL_TEXTURE_2D, 0, GL_RG16F, MAP, MAP, 0, GL_RG, GL_FLOAT, xy);
    glGenerateMipmap(GL_TEXTURE_2D);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_LINEAR_MIPMAP_LINEAR);
    return texture;
}

static guint microfacet_times_mesh(const struct mesh *mesh) {
    GLuint array, buffers[2];
    glGenVertexArrays(1, &array);
    glGenBuffers(2, buffers);
    glBindVertexArray(array);
    glBindBuffer(GL_ARRAY_BUFFER, buffers[0]);
    glBufferData(GL_ARRAY_BUFFER, (gssize)(mesh->n_vertices * sizeof *mesh->vertices),
                 mesh->vertices, GL_STATIC_DRAW);
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, buffers[1]);
    glBufferData(GL_ELEMENT_ARRAY_BUFFER, (gssize)(mesh->n_indices * sizeof *mesh->indices),
                 mesh->indices, GL_STATIC_DRAW);
    viewer_vertex_attributes();
    return array;
}

static void microfacet_times_uniform(GLuint program, const char *name, const float rgb[3]) {
    glUniform3fv(glGetUniformLocation(program, name), 1, rgb);
}

/* A frame with the camera and the light of time_in_turns(). */
static void microfacet_times_frame(GLuint program, const struct mesh *mesh,
                                   const struct microfacet *surface, int k) {
    struct viewer_settings s = viewer_settings_default;
    float projection[16], eye[3], light[3];
    s.camera_azimuth_deg = 40 + 7 * k;
    s.light_phi_deg = 100 - 11 * k;
    s.camera_distance = 4;
    camera_matrix(&s, (double)mesh->radius, (double)mesh->radius, (double)WIDTH / HEIGHT,
                  projection, eye);
    direction_from_deg((float)s.light_theta_deg, (float)s.light_phi_deg, light);
    glUseProgram(program);
    glUniformMatrix4fv(glGetUniformLocation(program, "projection"), 1, GL_FALSE, projection);
    glUniform2f(glGetUniformLocation(program, "tiles"), (float)mesh->tiles_u, (float)mesh->tiles_v);
    glUniform1i(glGetUniformLocation(program, "normals"), 0);
    microfacet_times_uniform(program, "eye", eye);
    microfacet_times_uniform(program, "light", light);
    microfacet_times_uniform(program, "diffuse", surface->diffuse);
    microfacet_times_uniform(program, "specular", surface->specular);
    glUniform2fv(glGetUniformLocation(program, "rough"), 1, surface->rough);
    glClear(GL_DEPTH_BUFFER_BIT | GL_COLOR_BUFFER_BIT);
    glDrawElements(GL_TRIANGLES, (GLsizei)mesh->n_indices, GL_UNSIGNED_INT, NULL);
    glFinish();
}

/* Median ms of each program, and of its time over that of the first for the same frame. draw(): k.
 */
struct microfacet_times_set {
    const struct mesh *mesh; /* NULL: a triangle that covers the screen */
    const struct microfacet *surface;
    GLuint programs[N_TIMED];
    int n;
};

/* Median ms of each program, and of its time over that of the first for the same frame. */
static void microfacet_times_set(const struct microfacet_times_set *set, int frames, double *ret_ms,
                                 double *ret_times) {
    const gsize n = (gsize)frames;
    g_autofree double *ms = g_new0(double, (gsize)set->n *n), *times = g_new(double, n);
    for (int k = -1; k < frames; k++)
        for (int i = 0; i < set->n; i++) {
            const int p = (i + k + 1) % set->n;
            const double start = now_us();
            if (set->mesh != NULL) {
                microfacet_times_frame(set->programs[p], set->mesh, set->surface, k);
            } else {
                glUseProgram(set->programs[p]);
                glUniform2f(glGetUniformLocation(set->programs[p], "turn"), 0.013F * (float)k,
                            0.017F * (float)k);
                glDrawArrays(GL_TRIANGLES, 0, 3);
                glFinish();
            }
            ms[(gsize)p * n + (gsize)MAX(k, 0)] = (now_us() - start) * 1e-3;
        }
    for (int p = set->n - 1; p >= 0; p--) {
        for (gsize k = 0; k < n; k++)
            times[k] = ms[(gsize)p * n + k] / ms[k];
        ret_times[p] = bench_time_quantile(times, frames, 0.5);
        ret_ms[p] = 0; /* sorting the first would part it from the others */
    }
    for (int p = 0; p < set->n; p++)
        ret_ms[p] = bench_time_quantile(ms + (gsize)p * n, frames, 0.5);
}

/* Largest difference of the pictures by two programs, relative to the brightest value. */
static double microfacet_times_difference(const struct microfacet_times_set *set, int a, int b) {
    const gsize n = (gsize)4 * WIDTH * HEIGHT;
    g_autofree float *one = g_new(float, n), *other = g_new(float, n);
    double worst = 0, most = 0;
    microfacet_times_frame(set->programs[a], set->mesh, set->surface, 0);
    glReadPixels(0, 0, WIDTH, HEIGHT, GL_RGBA, GL_FLOAT, one);
    microfacet_times_frame(set->programs[b], set->mesh, set->surface, 0);
    glReadPixels(0, 0, WIDTH, HEIGHT, GL_RGBA, GL_FLOAT, other);
    for (gsize k = 0; k < n; k++)
        if (k % 4 < 3) {
            worst = fmax(worst, fabs((double)one[k] - (double)other[k]));
            most = fmax(most, (double)one[k]);
        }
    return worst / most;
}

static void microfacet_times_table(enum microfacet_model model, const struct mesh *mesh,
                                   int frames) {
    const double none[2] = {0.5, 0.5};
    struct microfacet surface;
    struct vec3 n;
    double ms[N_TIMED], times[N_TIMED];
    microfacet_surface_at(MICROFACET_METAL, model, none, &surface, &n);
    struct microfacet_times_set set = {mesh, &surface, {0}, N_TIMED};
    for (int k = 0; k < N_TIMED; k++)
        set.programs[k] = microfacet_times_program(model, timed[k].way);
    microfacet_times_set(&set, frames, ms, times);
    bench_begin(NULL);
    bench_put("%s{model}", model == MICROFACET_WARD ? "ward" : "ashikhmin");
    for (int k = 0; k < N_TIMED; k++) {
        bench_put_double(timed[k].key, "_ms", "%.3f", ms[k]);
        /* times that at the vertices (gouraud) */
        bench_put_double(timed[k].key, "_cost", "%.4f", times[k]);
    }
    /* Largest, of pictures, relative to the brightest value. */
    bench_put("%.6f{matrix_difference} %.4f{approximate_difference}",
              microfacet_times_difference(&set, EXACT, MATRIX),
              microfacet_times_difference(&set, EXACT, APPROXIMATE));
    bench_end();
    for (int k = 0; k < N_TIMED; k++)
        glDeleteProgram(set.programs[k]);
}

static void microfacet_times_rotations(int frames) {
    static const int ways[] = {METHOD_ROTATION_NONE, METHOD_ROTATION_APPROXIMATE,
                               METHOD_ROTATION_EXACT, 3};
    struct microfacet_times_set set = {NULL, NULL, {0}, G_N_ELEMENTS(ways)};
    double ms[N_TIMED], times[N_TIMED];
    for (int k = 0; k < set.n; k++)
        set.programs[k] = microfacet_times_alone(ways[k]);
    microfacet_times_set(&set, frames, ms, times);
    const double share = 1e6 / ((double)WIDTH * HEIGHT * REPEATS); /* ns of one */
    const double approximate = (ms[1] - ms[0]) * share, exact = (ms[2] - ms[0]) * share;
    const double matrix = (ms[3] - ms[0]) * share;
    bench_row("rotation_ns",
              "%.4f{approximate} %.4f{exact} %.4f{matrix} %.3f{matrix_over_approximate} "
              "%.3f{matrix_over_exact}",
              approximate, exact, matrix, matrix / approximate, matrix / exact);
    for (int k = 0; k < set.n; k++)
        glDeleteProgram(set.programs[k]);
}

gboolean microfacet_times(int frames, GError **error) {
    struct gpu_target target = {0};
    if (!gpu_target_resize(&target, WIDTH, HEIGHT, GL_RGBA16F, TRUE, error))
        return FALSE;
    struct mesh *mesh = scene_torus(1.0, 0.4, 192, 96);
    GLuint normals = microfacet_times_normals();
    GLuint array = microfacet_times_mesh(mesh);
    glBindFramebuffer(GL_FRAMEBUFFER, target.framebuffer);
    glViewport(0, 0, WIDTH, HEIGHT);
    glEnable(GL_DEPTH_TEST);
    glDepthFunc(GL_LESS);
    glDepthMask(GL_TRUE);
    glEnable(GL_CULL_FACE); /* as the viewer shades front faces only */
    bench_begin_list("costs");
    microfacet_times_table(MICROFACET_WARD, mesh, frames);
    microfacet_times_table(MICROFACET_ASHIKHMIN, mesh, frames);
    bench_end();
    glDisable(GL_DEPTH_TEST);
    glDisable(GL_CULL_FACE);
    microfacet_times_rotations(frames);
    glDeleteVertexArrays(1, &array);
    glDeleteTextures(1, &normals);
    gpu_target_clear(&target);
    mesh_free(mesh);
    return gpu_check("the costs of Table I", error);
}
