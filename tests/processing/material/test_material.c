/* What libmesorig-material evaluates, against plain sums over what each codec's own functions give.
 */
#include "btf/direction_grid.h"
#include "codecs/lobes/lobes_levels.h"
#include "directions/directions.h"
#include "lib/hsh_formula.h"
#include "lib/material_fixture.h"
#include "lib/neural_fixture.h"
#include "lib/ok.h"
#include "lib/remove_tree.h"
#include "lib/test.h"

#include <math.h>
#include <mesorig/material.h>
#include <string.h>

/* Statuses cross the binary interface as plain ints, so that the test material_abi cannot see them.
 */
G_STATIC_ASSERT(MESORIG_OK == 0 && MESORIG_ERROR_ARGUMENT == 1 && MESORIG_ERROR_FILE == 2);
G_STATIC_ASSERT(MESORIG_ERROR_FORMAT == 3 && MESORIG_ERROR_MEMORY == 4);

#define POINTS 400

/* A codec's file, as a plain evaluation sees it. */
struct plain {
    const struct codec *codec;
    gpointer model;
    const struct btf_layout *layout;
    Directions *views, *lights;
    float *values; /* of all texels, reconstructed; tables only */
    gboolean is_table;
    int n_grid;
};

struct file {
    const char *codec, *options;
    gboolean with_pole;
};

/* Returns whether a model is a table, which is compared with sums over what it reconstructs. The
 * value of a table depends only on the measured directions and their weights. That of a formula
 * depends on the light. */
static gboolean is_table(const struct codec *codec, gconstpointer model) {
    static const float lights[2][3] = {{0.6F, 0, 0.8F}, {0, 0.28F, 0.96F}};
    const int zero = 0, texel = MATERIAL_WIDTH + 1;
    const float one = 1;
    const struct codec_texels texels = {1, &texel, &one};
    float rgb[2][3] = {{0}};
    for (int k = 0; k < 2; k++) {
        struct codec_query query = {.view = {0, 0, 1},
                                    .n_views = 1,
                                    .n_lights = 1,
                                    .views = &zero,
                                    .lights = &zero,
                                    .view_weights = &one,
                                    .light_weights = &one};
        memcpy(query.light, lights[k], sizeof query.light);
        codec->evaluate(model, &query, &texels, rgb[k]);
    }
    g_assert_cmpfloat(rgb[0][0], !=, 0);
    return rgb[0][0] == rgb[1][0] && rgb[0][1] == rgb[1][1] && rgb[0][2] == rgb[1][2];
}

static void plain_open(struct plain *p, const struct codec *codec, const char *path) {
    g_autoptr(GError) error = NULL;
    p->codec = codec;
    p->model = ok(codec->read(path, ERR));
    p->layout = G_STRUCT_MEMBER_P(p->model, codec->layout);
    p->n_grid = codec->grid ? codec->grid(p->model) : 0;
    p->is_table = is_table(codec, p->model);
    p->views = directions_new(p->layout->views.theta_deg, p->layout->views.phi_deg,
                              (int)p->layout->views.n, &error);
    p->lights = directions_new(p->layout->lights.theta_deg, p->layout->lights.phi_deg,
                               (int)p->layout->lights.n, &error);
    const gsize n = btf_layout_texels(p->layout), d = btf_layout_values(p->layout);
    p->values = g_new(float, n *d);
    for (gsize k = 0; k < n; k++)
        codec->reconstruct(p->model, (int)k, p->values + k * d);
}

static void plain_clear(struct plain *p) {
    p->codec->free(p->model);
    directions_free(p->views);
    directions_free(p->lights);
    g_free(p->values);
}

/* Weights of all directions: up to four, or the members of the pole. */
static void all_weights(const struct plain *p, gboolean lights, const float *d, double *ret) {
    const Directions *of = lights ? p->lights : p->views;
    const gsize n = lights ? p->layout->lights.n : p->layout->views.n;
    struct direction_weights at;
    int n_pole;
    const int *pole = directions_pole(of, &n_pole);
    memset(ret, 0, sizeof(double) * n);
    if (p->n_grid > 0) {
        direction_grid_weights(p->n_grid, d, at.index, at.weight);
        for (int k = 0; k < 4; k++)
            ret[at.index[k]] += at.weight[k];
        return;
    }
    directions_weights(of, vec3(d[0], d[1], d[2]), &at);
    const double fade = lights ? directions_fade(of, vec3(d[0], d[1], d[2])) : 1;
    for (int k = 0; k < 4; k++)
        if (at.index[k] < (int)n)
            ret[at.index[k]] += fade * at.weight[k];
        else
            for (int i = 0; i < n_pole; i++)
                ret[pole[i]] += fade * at.weight[k] / n_pole;
}

/* The value of one texel at a light, of one view if the model has one for each. A codec without a
 * formula here is asked for it: its own test compares its evaluate() with its formula. */
static void plain_formula(const struct plain *p, int view, int texel, const float *v,
                          const float *l, float ret[3]) {
    memset(ret, 0, 3 * sizeof(float));
    if (strcmp(p->codec->name, "hsh") == 0) {
        hsh_formula(p->model, view, texel, l, ret);
    } else if (p->codec->read == codecs_find("ptm")->read) { /* all lobes have one reader */
        const struct lobes *lobes = p->model;
        lobes_evaluate(lobes, lobes->n_slices > 1 ? view : 0, texel, v, l, ret);
    } else {
        const gsize n_lights = p->layout->lights.n;
        g_autofree double *h = g_new(double, n_lights);
        g_autofree float *light_weights = g_new(float, n_lights);
        g_autofree int *lights = g_new(int, n_lights);
        const float one = 1;
        struct codec_query query = {.n_views = 1,
                                    .views = &view,
                                    .lights = lights,
                                    .view_weights = &one,
                                    .light_weights = light_weights};
        const struct codec_texels texels = {1, &texel, &one};
        memcpy(query.view, v, sizeof query.view);
        memcpy(query.light, l, sizeof query.light);
        all_weights(p, TRUE, l, h);
        for (gsize b = 0; b < n_lights; b++)
            if (h[b] > 0) {
                lights[query.n_lights] = (int)b;
                light_weights[query.n_lights++] = (float)h[b];
            }
        p->codec->evaluate(p->model, &query, &texels, ret);
    }
    for (int c = 0; c < 3; c++)
        ret[c] = MAX(ret[c], 0);
}

static void plain_texel(const struct plain *p, int texel, const float *v, const float *l,
                        double ret[3]) {
    const gsize n_views = p->layout->views.n, n_lights = p->layout->lights.n;
    g_autofree double *g = g_new(double, n_views), *h = g_new(double, n_lights);
    all_weights(p, FALSE, v, g);
    all_weights(p, TRUE, l, h);
    ret[0] = ret[1] = ret[2] = 0;
    for (gsize a = 0; a < n_views; a++) {
        float rgb[3];
        if (g[a] == 0)
            continue;
        if (!p->is_table) {
            plain_formula(p, (int)a, texel, v, l, rgb);
            for (int c = 0; c < 3; c++)
                ret[c] += g[a] * rgb[c];
            continue;
        }
        for (gsize b = 0; b < n_lights; b++)
            for (gsize c = 0; c < 3; c++)
                ret[c] +=
                    g[a] * h[b] * p->values[(((gsize)texel * n_views + a) * n_lights + b) * 3 + c];
    }
}

static void plain_value(const struct plain *p, const float *uv, const float *v, const float *l,
                        double ret[3]) {
    const int w = (int)p->layout->width, h = (int)p->layout->height;
    const double x = (uv[0] - floor((double)uv[0])) * w - 0.5;
    const double y = (uv[1] - floor((double)uv[1])) * h - 0.5;
    ret[0] = ret[1] = ret[2] = 0;
    if (strcmp(p->codec->name, "neural") == 0) {
        neural_formula_point(p->model, x + 0.5, y + 0.5,
                             (double[]){(double)v[0], (double)v[1], (double)v[2]},
                             (double[]){(double)l[0], (double)l[1], (double)l[2]}, ret);
        return;
    }
    for (int k = 0; k < 4; k++) {
        const int i = (int)floor(x) + k % 2, j = (int)floor(y) + k / 2;
        const double share = (1 - fabs(x - i)) * (1 - fabs(y - j));
        double rgb[3];
        plain_texel(p, (j + h) % h * w + (i + w) % w, v, l, rgb);
        for (int c = 0; c < 3; c++)
            ret[c] += share * rgb[c];
    }
    for (int c = 0; c < 3; c++)
        ret[c] = MAX(ret[c], 0);
}

static void random_direction(GRand *random, float ret[3]) {
    const double z = g_rand_double_range(random, 0.02, 1), phi = g_rand_double(random) * 2 * G_PI;
    ret[0] = (float)(sqrt(1 - z * z) * cos(phi));
    ret[1] = (float)(sqrt(1 - z * z) * sin(phi));
    ret[2] = (float)z;
}

static void test_values(gconstpointer data) {
    const struct file *of = data;
    const struct codec *codec = codecs_find(of->codec);
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "x.exr", NULL);
    g_autoptr(BtfMatrix) btf = material_fixture_btf(of->with_pole);
    g_autoptr(GRand) random = g_rand_new_with_seed(7);
    struct mesorig_error error = {0};
    struct plain plain = {0};
    float uv[POINTS][2], view[POINTS][3], light[POINTS][3], rgb[POINTS][3];
    material_fixture_write(path, codec, btf, of->options);
    plain_open(&plain, codec, path);
    if (strcmp(codec->name, "lpca") == 0 || strcmp(codec->name, "hsh") == 0)
        g_assert_cmpint(plain.is_table, ==, codec->name[0] == 'l');
    mesorig_material *material = mesorig_material_open(path, NULL, &error);
    g_assert_cmpstr(error.text, ==, "");
    struct mesorig_material_info info = {.size = sizeof info};
    g_assert_cmpint(mesorig_material_info(material, &info), ==, MESORIG_OK);
    g_assert_cmpstr(info.kind, ==, of->codec);
    g_assert_cmpint(info.width, ==, MATERIAL_WIDTH);
    g_assert_cmpint(info.height, ==, MATERIAL_HEIGHT);
    g_assert_cmpint(info.n_views, ==, plain.layout->views.n);
    g_assert_cmpint(info.has_relief, ==, 0);
    g_assert_cmpfloat_with_epsilon(info.texel_mm, 0.5, 1e-9);
    g_assert_cmpfloat(info.error, <, 0.6); /* PTM of a highlight: 0.31 */
    for (int k = 0; k < POINTS; k++) {
        uv[k][0] = (float)g_rand_double_range(random, -2, 3);
        uv[k][1] = (float)g_rand_double_range(random, -2, 3);
        random_direction(random, view[k]);
        random_direction(random, light[k]);
        if (k % 20 == 0) /* the pole itself */
            memcpy(view[k], (float[]){0, 0, 1}, sizeof view[k]);
    }
    g_assert_cmpint(
        mesorig_material_evaluate(material, POINTS, uv[0], view[0], light[0], NULL, rgb[0]), ==,
        MESORIG_OK);
    double brightest = 0;
    for (int k = 0; k < POINTS; k++) {
        double expected[3];
        plain_value(&plain, uv[k], view[k], light[k], expected);
        for (int c = 0; c < 3; c++) {
            g_assert_cmpfloat_with_epsilon(rgb[k][c], expected[c], 3e-6 + 3e-5 * fabs(expected[c]));
            brightest = fmax(brightest, expected[c]);
        }
    }
    g_assert_cmpfloat(brightest, >, 0.1); /* the fixture's diffuse part is 0.4 n·l */
    mesorig_material_close(material);
    plain_clear(&plain);
}

/* Options that change how a file is evaluated. Every codec is also tested with its defaults. */
static const struct file with_options[] = {
    {"lpca", "clusters=3 components=4", TRUE},
    {"lpca", "clusters=3 components=4", FALSE},
    {"lpca", "clusters=2 components=3 colours=log", FALSE},
    {"lpca", "clusters=2 components=3 quantise=8bit-weights", TRUE},
    {"lpca", "quantise=packed error=2%", TRUE},
    {"lpca", "clusters=2 components=3 grid=5", TRUE},
    {"hsh", "terms=16", FALSE},
};

/* A footprint's value is the mean over its square: here of 48 × 48 points. */
TEST(footprint) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "x.exr", NULL);
    g_autoptr(BtfMatrix) btf = material_fixture_btf(TRUE);
    enum { N = 48 };
    static const float widths[] = {0.05F, 0.31F, 0.5F, 1, 3};
    const float view[] = {0.3F, -0.2F, 0.9F}, light[] = {-0.1F, 0.4F, 0.8F};
    const float uv[] = {0.37F, 0.81F};
    material_fixture_write(path, codecs_find("lpca"), btf, "clusters=3 components=4");
    mesorig_material *material = mesorig_material_open(path, NULL, NULL);
    g_assert_nonnull(material);
    for (gsize k = 0; k < G_N_ELEMENTS(widths); k++) {
        const double width = MIN(widths[k], 1);
        double mean[3] = {0};
        float rgb[3];
        for (int i = 0; i < N * N; i++) {
            const int column = i % N, row = i / N;
            const float at[] = {uv[0] + (float)(width * ((column + 0.5) / N - 0.5)),
                                uv[1] + (float)(width * ((row + 0.5) / N - 0.5))};
            mesorig_material_evaluate(material, 1, at, view, light, NULL, rgb);
            for (int c = 0; c < 3; c++)
                mean[c] += rgb[c] / (double)(N * N);
        }
        mesorig_material_evaluate(material, 1, uv, view, light, &widths[k], rgb);
        for (int c = 0; c < 3; c++)
            g_assert_cmpfloat_with_epsilon(rgb[c], mean[c], 2e-4);
    }
    mesorig_material_close(material);
}

/* Two texels wide is one level up: what a material of that level alone has there. */
TEST(mips) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "x.exr", NULL);
    g_autoptr(BtfMatrix) btf = material_fixture_btf(TRUE);
    const float view[] = {0.3F, -0.2F, 0.9F}, light[] = {-0.1F, 0.4F, 0.8F};
    const float footprint = 2.0F / MATERIAL_WIDTH;
    struct lobes *levels[16] = {NULL};
    material_fixture_write(path, codecs_find("ward"), btf, "mips=yes");
    mesorig_material *material = mesorig_material_open(path, NULL, NULL);
    g_assert_nonnull(material);
    const int n = lobes_read_levels(path, levels, NULL);
    g_assert_cmpint(n, >=, 3);
    float v[3], l[3];
    for (int i = 0; i < 3; i++) {
        v[i] = view[i] / sqrtf(0.3F * 0.3F + 0.2F * 0.2F + 0.9F * 0.9F);
        l[i] = light[i] / sqrtf(0.1F * 0.1F + 0.4F * 0.4F + 0.8F * 0.8F);
    }
    for (int j = 0; j < (int)levels[1]->layout.height; j++)
        for (int i = 0; i < (int)levels[1]->layout.width; i++) {
            const float uv[] = {((float)i + 0.5F) / (float)levels[1]->layout.width,
                                ((float)j + 0.5F) / (float)levels[1]->layout.height};
            float rgb[3], expected[3];
            mesorig_material_evaluate(material, 1, uv, view, light, &footprint, rgb);
            lobes_evaluate(levels[1], 0, j * (int)levels[1]->layout.width + i, v, l, expected);
            for (int c = 0; c < 3; c++)
                g_assert_cmpfloat_with_epsilon(rgb[c], MAX(expected[c], 0), 1e-5);
        }
    for (int k = 0; k < n; k++)
        lobes_free(levels[k]);
    mesorig_material_close(material);
}

static void add_file(struct file file) {
    static int n;
    g_autofree char *path = g_strdup_printf("/material/values/%d-%s", n++, file.codec);
    g_test_add_data_func_full(path, g_memdup2(&file, sizeof file), test_values, g_free);
}

BEFORE_TESTS {
    for (gsize k = 0; k < G_N_ELEMENTS(with_options); k++)
        add_file(with_options[k]);
    for (gsize k = 0; codecs[k]; k++)
        for (int with_pole = 0; with_pole < 2; with_pole++)
            add_file((struct file){codecs[k]->name, "", with_pole});
}
