/* What the interface promises for every codec in the table. */
#include "base/data_error.h"
#include "codecs/codec/compare.h"
#include "codecs/codecs.h"
#include "codecs/eigenmaps/eigenmaps_codec.h"
#include "lib/ok.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "lib/waves_fixture.h"

#include <string.h>

#define WIDTH  6
#define HEIGHT 5
#define VIEWS  4
#define LIGHTS 7

TEST(table) {
    for (gsize i = 0; codecs[i]; i++) {
        const struct codec *codec = codecs[i];
        g_assert_true(codecs_find(codec->name) == codec);
        g_assert_true(codec->title && *codec->title && codec->help && *codec->help);
        g_assert_true(codec->encode && codec->describe && codec->write && codec->read &&
                      codec->describe_file && codec->free && codec->layout && codec->bytes &&
                      codec->reconstruct && codec->evaluate && codec->curve);
        for (const struct option *option = codec->options; option->name; option++)
            g_assert_cmpuint(option->offset, <, codec->options_size);
    }
    g_assert_null(codecs_find("wavelets"));
    g_assert_null(codecs_find(NULL));
}

/* The desktop opens the file of each codec by its name. */
TEST(mime) {
    g_autofree char *text = NULL;
    g_assert_true(g_file_get_contents(BUILD_DIR "/etc/org.mesorig.xml", &text, NULL, NULL));
    g_assert_true(g_str_has_prefix(text, "<?xml") && g_str_has_suffix(text, "</mime-info>\n"));
    for (gsize i = 0; codecs[i]; i++) {
        g_autofree char *glob = g_strdup_printf("<glob pattern=\"%s.exr\"", codecs[i]->name);
        if (!strstr(text, glob))
            g_error("org.mesorig.xml has no %s", glob);
    }
}

/* Encodes with every option at its default, and gives the result and the matrix. */
static void encode(const struct codec *codec, const struct btf_matrix *btf,
                   struct codec_result *ret) {
    static const struct work quiet;
    g_autofree gpointer options = g_malloc0(codec->options_size);
    options_defaults(codec->options, options);
    const struct codec_job job = {.btf = btf, .options = options, .work = &quiet};
    *ret = (struct codec_result){0};
    g_assert_true(ok(codec->encode(codec, &job, ret, ERR)));
    g_assert_nonnull(ret->levels);
    g_assert_cmpuint(ret->levels->len, ==, 1);
}

/* The errors that a codec tells are those of what its file gives back. */
static void assert_errors(const struct codec *codec, gconstpointer model,
                          const struct btf_matrix *btf, const struct codec_result *result) {
    double found, luminance;
    g_assert_true(ok(compare_model(codec, model, btf, NULL, &found, &luminance, ERR)));
    g_assert_cmpfloat_with_epsilon(found, result->error, 1e-3);
    if (result->luminance_error >= 0)
        g_assert_cmpfloat_with_epsilon(luminance, result->luminance_error, 1e-3);
}

/* At a measured view under a measured light, evaluate() gives what reconstruct() gives, at least 0.
 */
static void assert_evaluates(const struct codec *codec, gconstpointer model) {
    const struct btf_layout *layout = G_STRUCT_MEMBER_P(model, codec->layout);
    const gsize n_lights = layout->lights.n;
    g_autofree float *views = direction_list_vectors(&layout->views);
    g_autofree float *lights = direction_list_vectors(&layout->lights);
    g_autofree float *values = g_new(float, btf_layout_values(layout));
    const float one = 1;
    for (int texel = 0; texel < WIDTH * HEIGHT; texel += 7) {
        codec->reconstruct(model, texel, values);
        for (int i = 0; i < (int)(layout->views.n * n_lights); i++) {
            const int view = i / (int)n_lights, light = i % (int)n_lights;
            struct codec_query query = {.n_views = 1,
                                        .n_lights = 1,
                                        .views = &view,
                                        .lights = &light,
                                        .view_weights = &one,
                                        .light_weights = &one};
            const struct codec_texels texels = {1, &texel, &one};
            float rgb[3] = {0};
            memcpy(query.view, views + 3 * view, sizeof query.view);
            memcpy(query.light, lights + 3 * light, sizeof query.light);
            codec->evaluate(model, &query, &texels, rgb);
            for (int c = 0; c < 3; c++)
                g_assert_cmpfloat_with_epsilon(MAX(rgb[c], 0), MAX(values[3 * i + c], 0), 1e-4);
        }
    }
}

/* Counts the bytes of the values in a file that has only level 0, without compression. A renderer
 * stores them in the same types, with the exceptions of this table. */
static gint64 count_bytes(const struct codec *codec, const struct exr_file *file) {
    static const struct {
        const char *codec, *part;
        gint64 bytes;
    } exceptions[] = {
        {"lpca", "clusters", 1},   /* up to 256 clusters */
        {"lpca", "scales", 0},     /* 1 if the values are halves */
        {"neural", "surface1", 1}, /* bytes */
        {"neural", "surface2", 1},     {"neural", "surface3", 1}, {"neural", "heights", 1},
        {"neural", "halves1", 1},      {"neural", "halves2", 1},  {"neural", "differences1", 1},
        {"neural", "differences2", 1}, {"neural", "weights1", 1}, {"neural", "weights2", 1},
        {"neural", "weights3", 1},     {NULL, "views", 0},        {NULL, "lights", 0},
    };
    gint64 sum = 0;
    for (guint i = 0; i < file->parts->len; i++) {
        const struct exr_part *part = file->parts->pdata[i];
        gint64 bytes = part->type == EXR_HALF ? 2 : 4;
        for (gsize k = 0; k < G_N_ELEMENTS(exceptions); k++)
            if ((!exceptions[k].codec || g_str_equal(exceptions[k].codec, codec->name)) &&
                g_str_equal(exceptions[k].part, part->name))
                bytes = exceptions[k].bytes;
        sum += bytes * part->width * part->height * part->n_channels;
    }
    return sum;
}

static void test_round_trip(gconstpointer data) {
    const struct codec *codec = data;
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "x.exr", NULL);
    g_autoptr(GError) error = NULL;
    struct btf_matrix *btf = waves_fixture_new(WIDTH, HEIGHT, VIEWS, LIGHTS, 0.002, FALSE);
    struct codec_result result;
    encode(codec, btf, &result);
    g_autofree char *described = codec->describe(codec, &result);
    g_assert_true(described && *described);
    g_assert_true(ok(codec->write(path, result.levels->pdata, 1, ERR)));
    g_autoptr(Material) material = material_open(path, NULL, &error);
    g_assert_no_error(error);
    const struct material_info *info = material_info(material);
    g_assert_cmpstr(info->kind, ==, codec->name);
    g_assert_cmpint(info->layout->width * info->layout->height, ==, WIDTH * HEIGHT);
    g_assert_cmpint(info->layout->views.n, ==, VIEWS);
    g_assert_cmpint(info->layout->lights.n, ==, LIGHTS);
    gpointer model = ok(codec->read(path, ERR));
    assert_errors(codec, model, btf, &result);
    assert_evaluates(codec, model);
    codec->free(model);
    struct exr_file *file = ok(exr_read_headers(path, ERR));
    g_assert_cmpint(info->bytes, ==, count_bytes(codec, file));
    g_autofree char *of_file = codec->describe_file(file);
    g_assert_true(of_file && *of_file);
    exr_file_free(file);
    g_ptr_array_unref(result.levels);
    btf_matrix_free(btf);
}

/* Maps for all views have no error but that of the half floats of the file. A requested error is
 * that of the file. */
TEST(eigenmaps_rounding) {
    static const struct work quiet;
    const struct codec *codec = &eigenmaps_codec;
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "x.exr", NULL);
    g_autoptr(GError) error = NULL;
    g_autoptr(BtfMatrix) btf = waves_fixture_new(WIDTH, HEIGHT, VIEWS, LIGHTS, 0.002, FALSE);
    g_autofree gpointer options = g_malloc0(codec->options_size);
    struct codec_job job = {.btf = btf, .options = options, .work = &quiet};
    struct codec_result result = {0};
    double found, luminance;
    options_defaults(codec->options, options);
    G_STRUCT_MEMBER(int, options, options_find(codec->options, "components")->offset) = VIEWS;
    g_assert_true(ok(codec->encode(codec, &job, &result, ERR)));
    g_assert_true(ok(codec->write(path, result.levels->pdata, 1, ERR)));
    gpointer model = ok(codec->read(path, ERR));
    g_assert_true(ok(compare_model(codec, model, btf, NULL, &found, &luminance, ERR)));
    g_assert_cmpfloat(found, >, 1e-5);
    g_assert_cmpfloat_with_epsilon(found, result.error, 0.01 * found);
    g_assert_cmpfloat(result.exact_error, <, 0.01 * found);
    codec->free(model);
    g_clear_pointer(&result.levels, g_ptr_array_unref);

    G_STRUCT_MEMBER(double, options, options_find(codec->options, "error")->offset) = 0.99 * found;
    g_assert_false(codec->encode(codec, &job, &result, &error));
    g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
    g_assert_nonnull(strstr(error->message, "which rounding them to half floats increases to"));
}

/* Options as the command line writes them. */
TEST(options) {
    const struct option share = {.name = "error", .type = OPTION_SHARE};
    const struct option bytes = {.name = "size", .type = OPTION_BYTES};
    static const char *const shares[] = {"2%", "0.02", "2.0%"};
    static const char *const no_shares[] = {"", "%", "0", "100%", "1", "-2%", "2%%", "two", "nan"};
    static const char *const sizes[] = {"20000000", "20MB", "20 MB", "0.02GB", "20000kB"};
    static const char *const no_sizes[] = {"", "0", "-1MB", "20mb", "MB", "1e9GB", "nan"};
    double value;
    gint64 size;
    for (gsize i = 0; i < G_N_ELEMENTS(shares); i++) {
        g_assert_true(options_set(&share, shares[i], &value, NULL));
        g_assert_cmpfloat_with_epsilon(value, 0.02, 1e-12);
    }
    for (gsize i = 0; i < G_N_ELEMENTS(sizes); i++) {
        g_assert_true(options_set(&bytes, sizes[i], &size, NULL));
        g_assert_cmpint(size, ==, 20000000);
    }
    for (gsize i = 0; i < G_N_ELEMENTS(no_shares); i++)
        g_assert_false(options_set(&share, no_shares[i], &value, NULL));
    for (gsize i = 0; i < G_N_ELEMENTS(no_sizes); i++)
        g_assert_false(options_set(&bytes, no_sizes[i], &size, NULL));
}

/* Leaves out one attribute of the file at a time. A reader that needs the attribute names the file.
 */
static void test_attributes(gconstpointer data) {
    const struct codec *codec = data;
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "x.exr", NULL);
    struct btf_matrix *btf = waves_fixture_new(WIDTH, HEIGHT, VIEWS, LIGHTS, 0.002, FALSE);
    struct codec_result result;
    encode(codec, btf, &result);
    g_assert_true(ok(codec->write(path, result.levels->pdata, 1, ERR)));
    g_autoptr(ExrFile) file = ok(exr_read(path, ERR));
    int refused = 0;
    for (guint i = 0; i < file->parts->len; i++) {
        const struct exr_part *part = file->parts->pdata[i];
        for (guint k = 0; k < part->attributes->len; k++) {
            g_autoptr(GError) error = NULL;
            struct exr_attribute *attribute = part->attributes->pdata[k];
            g_autofree char *name = g_steal_pointer(&attribute->name);
            attribute->name = g_strdup("without");
            g_assert_true(ok(exr_write(path, file, EXR_ZIP, FALSE, ERR)));
            gpointer model = codec->read(path, &error);
            g_assert_true((model != NULL) == (error == NULL));
            if (model)
                codec->free(model);
            else if (!strstr(error->message, path))
                g_error("without %s in %s: %s", name, part->name, error->message);
            refused += error != NULL;
            g_free(attribute->name);
            attribute->name = g_steal_pointer(&name);
        }
    }
    g_assert_cmpint(refused, >=, 2);
    g_ptr_array_unref(result.levels);
    btf_matrix_free(btf);
}

BEFORE_TESTS {
    for (gsize i = 0; codecs[i]; i++) {
        g_autofree char *path = g_strdup_printf("/codecs/round-trip/%s", codecs[i]->name);
        g_autofree char *attributes = g_strdup_printf("/codecs/attributes/%s", codecs[i]->name);
        g_test_add_data_func(path, codecs[i], test_round_trip);
        g_test_add_data_func(attributes, codecs[i], test_attributes);
    }
}
