#include "lpca_rendering_parts.h"

#include "bench.h"
#include "codecs/lpca/lpca_resample.h"
#include "drawing/methods/lpca_grid.h"
#include "drawing/methods/lpca_revised.h"
#include "drawing/methods/lpca_view.h"
#include "frame_time.h"
#include "scene/viewer.h"
#include "shapes/scene.h"

#include <epoxy/gl.h>

/* Every fetch of the shaders goes through one of these functions. Clusters are fetched once a
 * pixel. */
static const char counted[] = "#extension GL_ARB_shader_atomic_counters : require\n"
                              "layout(binding = 0, offset = 0) uniform atomic_uint of_clusters;\n"
                              "layout(binding = 0, offset = 4) uniform atomic_uint of_directions;\n"
                              "layout(binding = 0, offset = 8) uniform atomic_uint plain;\n"
                              "layout(binding = 0, offset = 12) uniform atomic_uint filtered;\n"
                              "vec4 counted_fetch(sampler2DArray s, ivec3 p, int level) {\n"
                              "    atomicCounterIncrement(plain);\n"
                              "    return texelFetch(s, p, level);\n"
                              "}\n"
                              "uvec4 counted_fetch(usampler2D s, ivec2 p, int level) {\n"
                              "    atomicCounterIncrement(of_clusters);\n"
                              "    return texelFetch(s, p, level);\n"
                              "}\n"
                              "uvec4 counted_fetch(usamplerBuffer s, int p) {\n"
                              "    atomicCounterIncrement(plain);\n"
                              "    return texelFetch(s, p);\n"
                              "}\n"
                              "vec4 counted_fetch(sampler2D s, ivec2 p, int level) {\n"
                              "    atomicCounterIncrement(of_directions);\n"
                              "    return texelFetch(s, p, level);\n"
                              "}\n"
                              "vec4 counted_lod(samplerCube s, vec3 p, float level) {\n"
                              "    atomicCounterIncrement(of_directions);\n"
                              "    return textureLod(s, p, level);\n"
                              "}\n"
                              "vec4 counted_lod(sampler3D s, vec3 p, float level) {\n"
                              "    atomicCounterIncrement(filtered);\n"
                              "    return textureLod(s, p, level);\n"
                              "}\n"
                              "#define texelFetch counted_fetch\n"
                              "#define textureLod counted_lod\n";
static const char blank[] = "vec4 blank_fetch(sampler2DArray s, ivec3 p, int level) {\n"
                            "    return vec4(p.xyzx) * 1e-3;\n"
                            "}\n"
                            "uvec4 blank_fetch(usampler2D s, ivec2 p, int level) {\n"
                            "    return texelFetch(s, p, level);\n"
                            "}\n"
                            "uvec4 blank_fetch(usamplerBuffer s, int p) {\n"
                            "    return uvec4(p, p << 3, p << 5, p << 7);\n"
                            "}\n"
                            "vec4 blank_fetch(sampler2D s, ivec2 p, int level) {\n"
                            "    return texelFetch(s, p, level);\n"
                            "}\n"
                            "vec4 blank_lod(samplerCube s, vec3 p, float level) {\n"
                            "    return textureLod(s, p, level);\n"
                            "}\n"
                            "vec4 blank_lod(sampler3D s, vec3 p, float level) {\n"
                            "    return p.xyzx;\n"
                            "}\n"
                            "#define texelFetch blank_fetch\n"
                            "#define textureLod blank_lod\n";

enum { PAIRS, REVISED, GRID, WAYS };
enum { WHOLE, COUNTED, BLANK, UNFILTERED, KINDS }; /* unfiltered: of the 3D texture only */

static GLuint unfiltered; /* a sampler object */

#define VARIANT(way, base, kind, text)                                                             \
    static char *fetches_constants_##way##_##kind(gconstpointer material,                          \
                                                  const struct method_style *style) {              \
        g_autofree char *own = (base).constants(material, style);                                  \
        return g_strconcat(own, text, NULL);                                                       \
    }                                                                                              \
    static void fetches_bind_##way##_##kind(gpointer material, guint program,                      \
                                            const struct method_style *style) {                    \
        (base).bind(material, program, style);                                                     \
        for (guint unit = 0; unit < METHOD_UNITS; unit++)                                          \
            glBindSampler(unit, (kind) == UNFILTERED ? unfiltered : 0);                            \
    }
#define VARIANTS(way, base)                                                                        \
    VARIANT(way, base, WHOLE, "")                                                                  \
    VARIANT(way, base, COUNTED, counted)                                                           \
    VARIANT(way, base, BLANK, blank)                                                               \
    VARIANT(way, base, UNFILTERED, "")
VARIANTS(PAIRS, method_lpca)
VARIANTS(REVISED, method_lpca_revised)
VARIANTS(GRID, method_lpca_grid)

#define HOOKS(way)                                                                                 \
    {                                                                                              \
        {fetches_constants_##way##_WHOLE, fetches_bind_##way##_WHOLE},                             \
            {fetches_constants_##way##_COUNTED, fetches_bind_##way##_COUNTED},                     \
            {fetches_constants_##way##_BLANK, fetches_bind_##way##_BLANK},                         \
            {fetches_constants_##way##_UNFILTERED, fetches_bind_##way##_UNFILTERED},               \
    }
static const struct {
    char *(*constants)(gconstpointer, const struct method_style *);
    void (*bind)(gpointer, guint, const struct method_style *);
} hooks[WAYS][KINDS] = {HOOKS(PAIRS), HOOKS(REVISED), HOOKS(GRID)};

static Viewer *fetches_viewer(struct lpca *lpca, struct lpca *grid, int way, int kind,
                              const struct mesh *mesh, GError **error) {
    static struct method methods_of[WAYS][KINDS];
    static const struct method *const bases[WAYS] = {&method_lpca, &method_lpca_revised,
                                                     &method_lpca_grid};
    gpointer material = way == PAIRS     ? (gpointer)lpca_view_new(&lpca, 1, error)
                        : way == REVISED ? (gpointer)lpca_revised_new(&grid, 1, 0, error)
                                         : (gpointer)lpca_grid_new(&grid, 1, 0, error);
    Viewer *viewer = material ? viewer_new(NULL, error) : NULL;
    struct method *method = &methods_of[way][kind];
    *method = *bases[way];
    method->constants = hooks[way][kind].constants;
    method->bind = hooks[way][kind].bind;
    if (!viewer || !viewer_set_mesh(viewer, mesh, error) ||
        !viewer_set_method(viewer, method, material, error)) {
        viewer_free(viewer);
        return NULL;
    }
    return viewer;
}

struct fetches {
    double directions, plain, filtered; /* of a pixel; plain: texels' weights and eigen-BRDFs */
};

static gboolean fetches_count(Viewer *viewer, const struct viewer_settings *s, struct fetches *ret,
                              GError **error) {
    const GLuint zero[4] = {0};
    GLuint buffer, found[4];
    glGenBuffers(1, &buffer);
    glBindBufferBase(GL_ATOMIC_COUNTER_BUFFER, 0, buffer);
    glBufferData(GL_ATOMIC_COUNTER_BUFFER, sizeof zero, zero, GL_DYNAMIC_READ);
    g_autofree float *picture = viewer_render_linear(viewer, s, 400, 300, error);
    viewer_finish();
    glMemoryBarrier(GL_BUFFER_UPDATE_BARRIER_BIT);
    glBindBuffer(GL_ATOMIC_COUNTER_BUFFER, buffer);
    glGetBufferSubData(GL_ATOMIC_COUNTER_BUFFER, 0, sizeof found, found);
    glDeleteBuffers(1, &buffer);
    const double pixels = MAX(found[0], 1);
    *ret = (struct fetches){found[1] / pixels, found[2] / pixels, found[3] / pixels};
    return picture != NULL && gpu_check("the counted fetches", error);
}

static void fetches_print(int c, const struct fetches *counts, double ms[WAYS][KINDS]) {
    static const char *const keys[WAYS] = {"pairs", "revised", "grid"};
    const struct fetches *p = &counts[PAIRS], *r = &counts[REVISED];
    bench_begin(NULL);
    bench_put("%d{components}", c);
    for (int way = 0; way < WAYS; way++)
        bench_row(keys[way],
                  "%.2f{directions} %.2f{plain} %.2f{filtered} %.2f{ms} %.2f{ms_without_fetches}",
                  counts[way].directions, counts[way].plain, counts[way].filtered, ms[way][WHOLE],
                  ms[way][BLANK]);
    bench_put("%.2f{revised_unfiltered_ms} %.3f{gain} %.3f{gain_unfiltered} %.3f{fetches_ratio}",
              ms[REVISED][UNFILTERED], ms[PAIRS][WHOLE] / ms[REVISED][WHOLE],
              ms[PAIRS][WHOLE] / ms[REVISED][UNFILTERED],
              (p->directions + p->plain) / (r->directions + r->plain + r->filtered));
    bench_end();
}

gboolean lpca_rendering_fetches(struct lpca *lpca, int n_grid, int frames, GError **error) {
    struct mesh *mesh = scene_torus(1.0, 0.4, 192, 96);
    struct lpca *grid = lpca_resample(lpca, n_grid, error);
    struct viewer_settings settings[WAYS * KINDS];
    Viewer *viewers[WAYS * KINDS] = {NULL};
    int n = 0, way_of[WAYS * KINDS], kind_of[WAYS * KINDS];
    double ms[WAYS][KINDS] = {{0}}, times[WAYS * KINDS] = {0};
    struct fetches counts[WAYS] = {{0}};
    gboolean good = grid != NULL;
    glGenSamplers(1, &unfiltered);
    glSamplerParameteri(unfiltered, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    glSamplerParameteri(unfiltered, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    for (int way = 0; good && way < WAYS; way++)
        for (int kind = 0; good && kind < KINDS; kind++) {
            Viewer *viewer = kind == UNFILTERED && way != REVISED
                                 ? NULL
                                 : fetches_viewer(lpca, grid, way, kind, mesh, error);
            if (viewer == NULL) {
                good = kind == UNFILTERED && way != REVISED;
                continue;
            }
            settings[n] = viewer_settings_default;
            settings[n].ambient = 0;
            if (kind == COUNTED) {
                good = fetches_count(viewer, &settings[n], &counts[way], error);
                viewer_free(viewer);
                continue;
            }
            way_of[n] = way;
            kind_of[n] = kind;
            viewers[n++] = viewer;
        }
    good = good && time_in_turns(viewers, settings, n, frames, times, NULL, error);
    for (int k = 0; k < n; k++) {
        ms[way_of[k]][kind_of[k]] = times[k];
        viewer_free(viewers[k]);
    }
    if (good)
        fetches_print(lpca->n_components, counts, ms);
    for (guint unit = 0; unit < METHOD_UNITS; unit++)
        glBindSampler(unit, 0);
    glDeleteSamplers(1, &unfiltered);
    lpca_free(grid);
    mesh_free(mesh);
    return good;
}
