/* Files of measured BRDFs against a reader in Python that shares nothing with ours. */
#include "exr/exr.h"
#include "formats/brdf/brdf.h"
#include "formats/brdf/merl.h"
#include "formats/brdf/rgl.h"
#include "formats/brdf/tensor_file.h"
#include "formats/brdf/utia.h"
#include "formats/brdf/warp.h"
#include "lib/folder.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/test.h"

#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

#define PAIRS     60
#define TOLERANCE 1e-5

static const struct work quietly = {0};

/* A rough metal on a coloured ground: reciprocal, and smooth but for a highlight. anisotropy: of
 * its roughness along x and y. */
struct metal {
    double along, across;
};
static const struct metal isotropic = {0.3, 0.3}, anisotropic = {0.2, 0.5};

static void metal(const float light[3], const float view[3], float ret[3], gpointer data) {
    const struct metal *of = data;
    const double h[3] = {(double)light[0] + (double)view[0], (double)light[1] + (double)view[1],
                         (double)light[2] + (double)view[2]};
    const double x = h[0] / h[2] / of->along, y = h[1] / h[2] / of->across;
    const double lobe = 0.2 / ((1 + x * x + y * y) * (1 + x * x + y * y));
    ret[0] = (float)(0.2 + lobe);
    ret[1] = (float)(0.1 + 0.8 * lobe);
    ret[2] = (float)(0.05 + 0.5 * lobe);
}

static void random_direction(GRand *rand, double lowest, double ret[3]) {
    const double z = g_rand_double_range(rand, lowest, 1);
    const double phi = g_rand_double_range(rand, -G_PI, G_PI), flat = sqrt(1 - z * z);
    ret[0] = flat * cos(phi), ret[1] = flat * sin(phi), ret[2] = z;
}

static double *random_pairs(void) {
    double *pairs = g_new(double, (gsize)6 * PAIRS);
    GRand *rand = g_rand_new_with_seed(7);
    for (int i = 0; i < 2 * PAIRS; i++)
        random_direction(rand, 0.15, pairs + (gsize)3 * i);
    g_rand_free(rand);
    return pairs;
}

/* n × channels numbers that the peer reads in the file at n pairs. */
static double *peer_values(const char *kind, const char *path, const double *pairs, gsize n,
                           gsize channels) {
    g_autofree char *from = in_folder("pairs"), *to = in_folder("values");
    const char *const argv[] = {
        "python3", SOURCE_DIR "/tests/brdf_peer.py", "evaluate", kind, path, from, to, NULL};
    char *bytes;
    gsize length;
    g_assert_true(
        g_file_set_contents(from, (const char *)pairs, (gssize)(n * 6 * sizeof *pairs), NULL));
    g_free(process_text(0, argv));
    g_assert_true(g_file_get_contents(to, &bytes, &length, NULL));
    g_assert_cmpuint(length, ==, n * channels * sizeof(double));
    return (double *)bytes;
}

static void floats(const double *from, float ret[3]) {
    for (int k = 0; k < 3; k++)
        ret[k] = (float)from[k];
}

static void assert_near(double value, double wanted) {
    g_assert_cmpfloat_with_epsilon(value, wanted, TOLERANCE * MAX(fabs(wanted), 0.1));
}

/* What we read in a file is what the peer reads. */
static void check_reading(const char *path, enum brdf_kind kind, const char *peer) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Brdf) brdf = brdf_open(path, kind, NULL, &error);
    g_assert_no_error(error);
    g_autofree double *pairs = random_pairs();
    g_autofree double *wanted = peer_values(peer, path, pairs, PAIRS, 3);
    for (gsize i = 0; i < PAIRS; i++) {
        float light[3], view[3], rgb[3];
        floats(pairs + 6 * i, light);
        floats(pairs + 6 * i + 3, view);
        brdf_evaluate(light, view, rgb, brdf);
        for (gsize c = 0; c < 3; c++)
            assert_near((double)rgb[c], wanted[3 * i + c]);
    }
}

static char *write_rgl(const char *name, const struct metal *of, gboolean turned) {
    char *path = in_folder(name);
    const struct rgl_options options = {.isotropic = turned, .n_turns = 1, .description = "métal"};
    struct rgl_result result;
    ok(rgl_write(path, metal, (gpointer)of, &options, &quietly, &result, ERR));
    g_assert_cmpint(result.n_phi, ==, turned ? 1 : 25);
    return path;
}

/* At the nodes of a file the peer finds the function that was written. */
static void check_nodes(const char *path, const struct metal *of) {
    g_autofree char *list = in_folder("nodes"), *bytes = NULL;
    const char *const argv[] = {"python3", SOURCE_DIR "/tests/brdf_peer.py", "nodes", path, list,
                                NULL};
    gsize length;
    g_free(process_text(0, argv));
    g_assert_true(g_file_get_contents(list, &bytes, &length, NULL));
    const gsize n = length / (6 * sizeof(double));
    const double *pairs = (const double *)bytes;
    g_assert_cmpuint(n, >, 40);
    g_autofree double *values = peer_values("rgl", path, pairs, n, 3);
    for (gsize i = 0; i < n; i++) {
        float light[3], view[3], rgb[3];
        floats(pairs + 6 * i, light);
        floats(pairs + 6 * i + 3, view);
        metal(light, view, rgb, (gpointer)of);
        for (gsize c = 0; c < 3; c++)
            assert_near(values[3 * i + c], (double)rgb[c]);
    }
}

/* Relative RMS difference of what the peer reads in a file from the function, at random pairs. Both
 * are multiplied by the cosine of the light, as the light that a surface reflects is. */
static double peer_error(const char *kind, const char *path, const struct metal *of) {
    g_autofree double *pairs = random_pairs();
    g_autofree double *values = peer_values(kind, path, pairs, PAIRS, 3);
    double differences = 0, squares = 0;
    for (gsize i = 0; i < PAIRS; i++) {
        float light[3], view[3], rgb[3];
        floats(pairs + 6 * i, light);
        floats(pairs + 6 * i + 3, view);
        metal(light, view, rgb, (gpointer)of);
        for (gsize c = 0; c < 3; c++) {
            const double cosine = pairs[6 * i + 2], truth = cosine * (double)rgb[c];
            const double difference = cosine * values[3 * i + c] - truth;
            differences += difference * difference;
            squares += truth * truth;
        }
    }
    g_test_message("%s: %.2f %% RMS", kind, 100 * sqrt(differences / squares));
    return sqrt(differences / squares);
}

static void test_rgl(gconstpointer data) {
    const gboolean turned = GPOINTER_TO_INT(data);
    const struct metal *of = turned ? &isotropic : &anisotropic;
    g_autofree char *path = write_rgl("metal.bsdf", of, turned);
    check_reading(path, BRDF_RGL, "rgl");
    check_nodes(path, of);
    g_assert_cmpfloat(peer_error("rgl", path, of), <, 0.01); /* between nodes */
}

/* A copy of a file with one field left out, or others instead of it. */
static char *copy_without(const char *path, const char *name, const struct tensor_field *with) {
    char *copy = in_folder("copy.bsdf");
    g_autoptr(TensorFile) file = tensor_file_read(path, NULL);
    for (guint i = 0; i < file->fields->len; i++) {
        const struct tensor_field *field = file->fields->pdata[i];
        if (strcmp(field->name, name) == 0) {
            g_ptr_array_remove_index(file->fields, i);
            break;
        }
    }
    if (with)
        tensor_file_add(file, name, with->type, with->n_dimensions, with->shape, with->values);
    g_assert_true(tensor_file_write(copy, file, NULL));
    return copy;
}

/* Spectra give the colours back that they were made of; a flat one is grey. */
TEST(rgl__spectra) {
    g_autofree char *path = write_rgl("metal.bsdf", &isotropic, TRUE);
    g_autofree char *copy = copy_without(path, "rgb", NULL);
    g_autoptr(Brdf) whole = brdf_open(path, BRDF_RGL, NULL, NULL);
    g_autoptr(Brdf) spectral = brdf_open(copy, BRDF_RGL, NULL, NULL);
    g_autofree double *pairs = random_pairs();
    g_autofree double *spectra = peer_values("spectra", copy, pairs, PAIRS, 6);
    for (gsize i = 0; i < PAIRS; i++) {
        float light[3], view[3], rgb[3], again[3];
        floats(pairs + 6 * i, light);
        floats(pairs + 6 * i + 3, view);
        brdf_evaluate(light, view, rgb, whole);
        brdf_evaluate(light, view, again, spectral);
        for (gsize c = 0; c < 3; c++)
            assert_near((double)again[c], (double)rgb[c]);
        /* Red reflects most: the red end of the spectrum is above its blue end. */
        g_assert_cmpfloat(spectra[6 * i + 5], >, spectra[6 * i]);
    }
}

/* A file without spectra has the same values, and lacks what makes it a spectral file to Mitsuba.
 */
TEST(rgl__rgb_only) {
    g_autofree char *path = in_folder("rgb.bsdf"),
                    *both = write_rgl("metal.bsdf", &isotropic, TRUE);
    const struct rgl_options options = {.isotropic = TRUE, .n_turns = 1, .rgb_only = TRUE};
    struct rgl_result result;
    ok(rgl_write(path, metal, (gpointer)&isotropic, &options, &quietly, &result, ERR));
    g_autoptr(TensorFile) file = ok(tensor_file_read(path, ERR));
    for (guint i = 0; i < file->fields->len; i++) {
        const struct tensor_field *field = file->fields->pdata[i];
        g_assert_cmpstr(field->name, !=, "wavelengths");
        g_assert_cmpstr(field->name, !=, "spectra");
    }
    g_autoptr(Brdf) whole = brdf_open(both, BRDF_RGL, NULL, NULL);
    g_autoptr(Brdf) only = brdf_open(path, BRDF_RGL, NULL, NULL);
    g_autofree double *pairs = random_pairs();
    for (gsize i = 0; i < PAIRS; i++) {
        float light[3], view[3], rgb[3], again[3];
        floats(pairs + 6 * i, light);
        floats(pairs + 6 * i + 3, view);
        brdf_evaluate(light, view, rgb, whole);
        brdf_evaluate(light, view, again, only);
        g_assert_cmpmem(rgb, sizeof rgb, again, sizeof again);
    }
}

static void metal_both(const float a[3], const float b[3], float ret[2][3], gpointer of) {
    metal(a, b, ret[0], of);
    metal(b, a, ret[1], of);
}

/* What renderers do with a file: the density of sampled directions integrates to at most 1, and
 * f cos θ / density has a small spread. warp_sample() and warp_invert() are each other's opposite.
 */
TEST(warp) {
    const struct warp_slices both = {2, {0, 1}, {0.3, 0.7}};
    float values[2 * 7 * 5];
    GRand *rand = g_rand_new_with_seed(3);
    for (gsize i = 0; i < G_N_ELEMENTS(values); i++)
        values[i] = i % 9 == 0 ? 0 : (float)g_rand_double(rand);
    g_autoptr(Warp) warp = warp_new(7, 5, 2, values);
    for (int i = 0; i < 500; i++) {
        const double s = g_rand_double(rand), t = g_rand_double(rand);
        double at[2], again[2];
        warp_sample(warp, &both, s, t, at);
        warp_invert(warp, &both, at[0], at[1], again);
        g_assert_cmpfloat_with_epsilon(again[0], s, 1e-5);
        g_assert_cmpfloat_with_epsilon(again[1], t, 1e-5);
    }
    g_rand_free(rand);
    /* p = 2x of two columns: s = x². */
    const float ramp[4] = {0, 1, 0, 1};
    const struct warp_slices one = {1, {0}, {1}};
    g_autoptr(Warp) rising = warp_new(2, 2, 1, ramp);
    double at[2];
    g_assert_cmpfloat_with_epsilon(warp_invert(rising, &one, 0.6, 0.25, at), 1.2, 1e-6);
    g_assert_cmpfloat_with_epsilon(at[0], 0.36, 1e-6);
    g_assert_cmpfloat_with_epsilon(at[1], 0.25, 1e-6);
    const float none[4] = {0, 0, 0, 0}, negative[4] = {1, 1, -1, 1};
    g_assert_null(warp_new(2, 2, 1, none));
    g_assert_null(warp_new(2, 2, 1, negative));
}

/* It takes 35 MB, and is written once. */
static char *merl_file(void) {
    char *path = in_folder("metal.binary");
    struct merl_result result;
    if (g_file_test(path, G_FILE_TEST_EXISTS))
        return path;
    ok(merl_write(path, metal_both, (gpointer)&isotropic, 1, &quietly, &result, ERR));
    g_assert_cmpfloat(result.spread, <, 1e-6);
    return path;
}

TEST(merl) {
    g_autofree char *path = merl_file();
    check_reading(path, BRDF_MERL, "merl");
    /* The peer's bins are the function at their centres: within a bin's width of it elsewhere. */
    g_assert_cmpfloat(peer_error("merl", path, &isotropic), <, 0.01);
}

/* Bins at their very centre hold the function, to the digits of a float. */
TEST(merl__centres) {
    g_autofree char *path = merl_file();
    double pairs[6 * PAIRS];
    GRand *rand = g_rand_new_with_seed(11);
    gsize n = 0;
    while (n < PAIRS) {
        const double root = (g_rand_int_range(rand, 0, 90) + 0.5) / 90, h = root * root * G_PI / 2;
        const double d = (g_rand_int_range(rand, 0, 90) + 0.5) / 180 * G_PI;
        const double phi = (g_rand_int_range(rand, 0, 180) + 0.5) / 180 * G_PI;
        const double turn = g_rand_double_range(rand, -3, 3);
        for (int side = 0; side < 2; side++) {
            const double sign = side ? -1 : 1, x = sign * sin(d) * cos(phi);
            const double y = sign * sin(d) * sin(phi), z = cos(d);
            const double across = cos(h) * x + sin(h) * z;
            pairs[6 * n + 3 * (gsize)side] = cos(turn) * across - sin(turn) * y;
            pairs[6 * n + 3 * (gsize)side + 1] = sin(turn) * across + cos(turn) * y;
            pairs[6 * n + 3 * (gsize)side + 2] = cos(h) * z - sin(h) * x;
        }
        n += pairs[6 * n + 2] > 0.01 && pairs[6 * n + 5] > 0.01;
    }
    g_rand_free(rand);
    g_autofree double *values = peer_values("merl", path, pairs, PAIRS, 3);
    for (gsize i = 0; i < PAIRS; i++) {
        float light[3], view[3], rgb[3];
        floats(pairs + 6 * i, light);
        floats(pairs + 6 * i + 3, view);
        metal(light, view, rgb, (gpointer)&isotropic);
        for (gsize c = 0; c < 3; c++)
            assert_near(values[3 * i + c], (double)rgb[c]);
    }
}

TEST(utia) {
    g_autoptr(GError) error = NULL;
    g_autofree char *bin = in_folder("made.bin"), *exr = in_folder("made.exr"), *bytes = NULL;
    static const char *const channels[] = {"B", "G", "R", NULL};
    const char *const argv[] = {"python3", SOURCE_DIR "/tests/brdf_peer.py", "utia", bin, NULL};
    const struct brdf_coding coding = {.divide = 2, .scale = 3, .srgb = TRUE};
    const float light[3] = {0, 0, 1}, view[3] = {0.6F, 0, 0.8F};
    float rgb[3], coded[3], flipped[3];
    gsize length;
    g_free(process_text(0, argv));
    check_reading(bin, BRDF_UTIA, "utia");

    g_assert_true(g_file_get_contents(bin, &bytes, &length, NULL));
    for (int upside_down = 0; upside_down < 2; upside_down++) {
        g_autoptr(ExrFile) file = exr_file_new();
        struct exr_part *part = exr_part_new("utia", 288, 288, channels, EXR_FLOAT);
        for (int i = 0; i < 3 * 288 * 288; i++) {
            const int y = i / 288 % 288, row = upside_down ? 287 - y : y;
            part->planes[2 - i / (288 * 288)][row * 288 + i % 288] =
                (float)((const double *)bytes)[i];
        }
        exr_file_add(file, part);
        g_assert_true(exr_write(exr, file, EXR_ZIP, FALSE, NULL));
        g_autoptr(Brdf) from_bin = brdf_open(bin, BRDF_UTIA, NULL, NULL);
        g_autoptr(Brdf) from_exr = brdf_open(exr, BRDF_UTIA, NULL, &error);
        g_assert_no_error(error);
        brdf_evaluate(light, view, rgb, from_bin);
        brdf_evaluate(light, view, flipped, from_exr);
        g_assert_cmpmem(rgb, sizeof rgb, flipped, sizeof flipped);
    }
    g_autoptr(Brdf) brdf = brdf_open(bin, BRDF_UTIA, &coding, NULL);
    const float measured[3] = {sinf(G_PI / 12), 0, cosf(G_PI / 12)}; /* a direction of the file */
    g_autoptr(Brdf) plain = brdf_open(bin, BRDF_UTIA, NULL, NULL);
    brdf_evaluate(light, measured, rgb, plain);
    brdf_evaluate(light, measured, coded, brdf);
    for (int c = 0; c < 3; c++) {
        const double value = (double)rgb[c] / 2;
        assert_near((double)coded[c],
                    3 * (value <= 0.04045 ? value / 12.92 : pow((value + 0.055) / 1.055, 2.4)));
    }
}

static void assert_refused(const char *path, enum brdf_kind kind, const char *words) {
    g_autoptr(GError) error = NULL;
    g_assert_null(brdf_open(path, kind, NULL, &error));
    g_assert_nonnull(error);
    assert_has(error->message, path);
    assert_has(error->message, words);
}

TEST(refused) {
    g_autofree char *good = write_rgl("metal.bsdf", &isotropic, TRUE);
    g_autofree char *path = in_folder("bad"), *merl = merl_file(), *bytes = NULL;
    gsize length;
    float phi[2] = {1, 0}, vndf[4] = {0}, infinite[4] = {INFINITY, 1, 1, 1};
    const struct tensor_field falling = {NULL, TENSOR_FLOAT32, 1, {2}, 2, 8, phi};
    const struct tensor_field empty = {NULL, TENSOR_FLOAT32, 4, {1, 1, 2, 2}, 4, 16, vndf};
    const struct tensor_field bytes_only = {NULL, TENSOR_INT16, 1, {2}, 2, 4, phi};
    const struct tensor_field wrong = {NULL, TENSOR_FLOAT32, 2, {2, 2}, 4, 16, infinite};
    g_free(copy_without(good, "sigma", NULL));
    g_autofree char *copy = copy_without(good, "sigma", NULL);
    assert_refused(copy, BRDF_RGL, "lacks the field “sigma”");
    g_free(copy_without(good, "phi_i", &falling));
    assert_refused(copy, BRDF_RGL, "“phi_i” must ascend");
    g_free(copy_without(good, "phi_i", &bytes_only));
    assert_refused(copy, BRDF_RGL, "“phi_i” has 1 dimensions of int16, but must have 1 of float32");
    g_free(copy_without(good, "vndf", &empty));
    assert_refused(copy, BRDF_RGL, "1 × 1 directions of incidence");
    g_free(copy_without(good, "ndf", &wrong));
    assert_refused(copy, BRDF_RGL, "number 1 of the field “ndf” is not finite");

    g_assert_true(g_file_set_contents(path, "tensor", -1, NULL));
    assert_refused(path, BRDF_RGL, "too short");
    assert_refused(path, BRDF_MERL, "only 6 bytes");
    assert_refused(path, BRDF_UTIA, "has 6 bytes");
    assert_refused("/no/such.bsdf", BRDF_RGL, "No such file");
    g_assert_true(g_file_get_contents(merl, &bytes, &length, NULL));
    g_assert_true(g_file_set_contents(path, bytes, (gssize)length - 8, NULL));
    assert_refused(path, BRDF_MERL, "copy it again");
    const double none = NAN;
    memcpy(bytes + 12 + 80, &none, sizeof none);
    g_assert_true(g_file_set_contents(path, bytes, (gssize)length, NULL));
    assert_refused(path, BRDF_MERL, "1 of the 4374000 numbers");
}

/* Cut anywhere, a file is refused; changed anywhere, it is refused or evaluates to numbers. */
TEST(mutated) {
    g_autofree char *good = write_rgl("metal.bsdf", &isotropic, TRUE);
    g_autofree char *path = in_folder("mutated"), *bytes = NULL;
    gsize length;
    GRand *rand = g_rand_new_with_seed(5);
    g_assert_true(g_file_get_contents(good, &bytes, &length, NULL));
    for (int i = 0; i < 60; i++) {
        const gsize cut = (gsize)g_rand_int_range(rand, 0, i % 2 ? 600 : (int)length);
        g_assert_true(g_file_set_contents(path, bytes, (gssize)cut, NULL));
        g_assert_null(brdf_open(path, BRDF_RGL, NULL, NULL));
    }
    for (int i = 0; i < 100; i++) {
        const gsize at = (gsize)g_rand_int_range(rand, 0, i % 4 ? 600 : (int)length);
        const char kept = bytes[at];
        bytes[at] = (char)g_rand_int_range(rand, 0, 256);
        g_assert_true(g_file_set_contents(path, bytes, (gssize)length, NULL));
        g_autoptr(GError) error = NULL;
        g_autoptr(Brdf) brdf = brdf_open(path, BRDF_RGL, NULL, &error);
        g_assert_true(brdf || error);
        const float light[3] = {0.6F, 0, 0.8F}, view[3] = {0, -0.6F, 0.8F};
        float rgb[3] = {0};
        if (brdf)
            brdf_evaluate(light, view, rgb, brdf);
        for (int c = 0; c < 3; c++)
            g_assert_true(isfinite(rgb[c]) && rgb[c] >= 0);
        bytes[at] = kept;
    }
    g_rand_free(rand);
}

BEFORE_TESTS {
    folder_make();
    g_test_add_data_func("/brdf/rgl/isotropic", GINT_TO_POINTER(TRUE), test_rgl);
    g_test_add_data_func("/brdf/rgl/anisotropic", GINT_TO_POINTER(FALSE), test_rgl);
}

AFTER_TESTS {
    folder_remove();
}
