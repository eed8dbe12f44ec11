/* Inputs from other people's computers that would become plausible but wrong numbers. Pictures of
 * a grey ball under known lights are made here, so that the truth is known. */
#include "base/data_error.h"
#include "base/robust.h"
#include "btf/btf_matrix.h"
#include "btf/near_field.h"
#include "formats/import.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "pictures/picture_says.h"
#include "scene/environment.h"

#include <glib/gstdio.h>

#include "lib/process.h"
#include "lib/session_fixture.h"
#include "lib/told_pictures.h"

#define SIDE   48
#define PIXELS (SIDE * SIDE)
#define RADIUS 22.0
#define ALBEDO 0.8

static const struct work quietly = {0};
static const struct told untold = {0};

static double encode(double v) {
    return v <= 0.0031308 ? 12.92 * v : 1.055 * pow(v, 1 / 2.4) - 0.055;
}

static double decode(double v) {
    return v <= 0.04045 ? v / 12.92 : pow((v + 0.055) / 1.055, 2.4);
}

/* Two rings of lights. */
static void light_of(int light, int n, double ret[3]) {
    const double theta = (light % 2 ? 60 : 30) * G_PI / 180, phi = 2 * G_PI * light / n;
    ret[0] = sin(theta) * cos(phi);
    ret[1] = sin(theta) * sin(phi);
    ret[2] = cos(theta);
}

/* The normal of a pixel of the ball; FALSE: it shows none. Row 0 is at +y. */
static gboolean normal_of(int i, double ret[3]) {
    ret[0] = (i % SIDE + 0.5 - SIDE / 2.0) / RADIUS;
    ret[1] = (SIDE / 2.0 - i / SIDE - 0.5) / RADIUS;
    const double square = ret[0] * ret[0] + ret[1] * ret[1];
    ret[2] = sqrt(MAX(1 - square, 0));
    return square < 0.95;
}

static double ball_value(int i, const double light[3]) {
    double n[3];
    if (!normal_of(i, n))
        return 0;
    return ALBEDO * MAX(n[0] * light[0] + n[1] * light[1] + n[2] * light[2], 0);
}

struct ball {
    int n_lights, n_dead, bits;
    gboolean srgb, masked;
    double level; /* of black, left in: a share of white */
    const struct told *told;
    enum picture_tones transfer;
};

/* Writes a set and imports it. notes: what the import said. */
static struct btf_matrix *import_ball(const struct ball *ball, GPtrArray *notes, char **ret_path) {
    g_autofree char *dir = session_fixture_new_folder(),
                    *list = g_build_filename(dir, "ball.lp", NULL);
    g_autofree char *path = session_fixture_path("ball");
    g_autoptr(GString) text = g_string_new(NULL);
    g_autofree guint16 *codes = g_new(guint16, 4 * PIXELS);
    const int white = (1 << ball->bits) - 1, channels = ball->masked ? 4 : 3;
    for (int l = 0; l < ball->n_lights; l++) {
        g_autofree char *name = g_strdup_printf("p%02d.png", l);
        g_autofree char *file = g_build_filename(dir, name, NULL);
        double d[3], n[3];
        light_of(l, ball->n_lights, d);
        for (int i = 0; i < PIXELS; i++) {
            const double light = l < ball->n_dead ? 0 : ball_value(i, d);
            const double v = ball->level + (1 - ball->level) * light;
            for (int c = 0; c < 3; c++)
                codes[channels * i + c] = (guint16)lround(white * (ball->srgb ? encode(v) : v));
            if (ball->masked)
                codes[channels * i + 3] = (guint16)(normal_of(i, n) ? white : 0);
        }
        told_png(file, SIDE, SIDE, channels, ball->bits, codes, ball->told);
        g_string_append_printf(text, "%s %.9f %.9f %.9f\n", name, d[0], d[1], d[2]);
    }
    g_assert_true(g_file_set_contents(list, text->str, -1, NULL));
    const struct import_wish wish = {.transfer = ball->transfer, .notes = notes};
    struct import_result result;
    ok(import_rti(path, list, &wish, &quietly, &result, ERR));
    struct btf_matrix *btf = ok(btf_matrix_read(path, NULL, ERR));
    if (ret_path)
        *ret_path = g_steal_pointer(&path);
    return btf;
}

/* Median angle between the normals of photometric stereo and the truth, in degrees. */
static double normal_error(const struct btf_matrix *btf) {
    const int n_lights = (int)btf->layout.lights.n;
    g_autoptr(GArray) errors = g_array_new(FALSE, FALSE, sizeof(double));
    for (int i = 0; i < PIXELS; i++) {
        double truth[3], a[3][4] = {{0}}, g[3];
        if (!normal_of(i, truth) || truth[2] < 0.5)
            continue;
        for (int l = 0; l < n_lights; l++) {
            const double theta = (double)btf->layout.lights.theta_deg[l] * G_PI / 180;
            const double phi = (double)btf->layout.lights.phi_deg[l] * G_PI / 180;
            const double row[4] = {sin(theta) * cos(phi), sin(theta) * sin(phi), cos(theta),
                                   (double)btf->values[(i * n_lights + l) * 3 + 1]};
            for (int r = 0; row[3] > 0.01 && r < 3; r++)
                for (int c = 0; c < 4; c++)
                    a[r][c] += row[r] * row[c];
        }
        for (int k = 0; k < 3; k++)
            for (int r = k + 1; r < 3; r++)
                for (int c = 3; c >= k; c--)
                    a[r][c] -= a[r][k] / a[k][k] * a[k][c];
        for (int k = 2; k >= 0; k--) {
            g[k] = a[k][3];
            for (int c = k + 1; c < 3; c++)
                g[k] -= a[k][c] * g[c];
            g[k] /= a[k][k];
        }
        const double length = sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2]);
        const double dot = (g[0] * truth[0] + g[1] * truth[1] + g[2] * truth[2]) / length;
        const double deg = acos(CLAMP(dot, -1, 1)) * 180 / G_PI;
        g_array_append_val(errors, deg);
    }
    g_array_sort(errors, (GCompareFunc)(void *)robust_by_value);
    return g_array_index(errors, double, errors->len / 2);
}

static const char *find_note(const GPtrArray *notes, const char *words) {
    for (guint i = 0; i < notes->len; i++)
        if (strstr(notes->pdata[i], words))
            return notes->pdata[i];
    return NULL;
}

TEST(ball) {
    static const guint8 linear[4] = {0, 1, 0x86, 0xa0}; /* gAMA 1.0 */
    static const struct told srgb = {.srgb = TRUE},
                             gama = {.png_chunk = "gAMA", .chunk = linear, .chunk_bytes = 4};
    static const struct {
        struct ball ball;
        const char *says; /* of the tones */
        const char *warns;
        double most_deg, least_deg;
    } sets[] = {
        {{12, 0, 8, TRUE, .told = &untold}, "sRGB, assumed for 8 bits", NULL, 0.5, 0},
        {{12, 0, 8, TRUE, .told = &srgb}, "sRGB, as the file says (PNG sRGB)", NULL, 0.5, 0},
        {{12, 0, 8, FALSE, .told = &gama}, "linear, as the file says (PNG gAMA 1)", NULL, 0.5, 0},
        {{12, 0, 8, FALSE, .told = &untold}, "sRGB, assumed for 8 bits", "read as linear", 30, 5},
        {{12, 0, 8, FALSE, .told = &untold, .transfer = PICTURE_TONES_LINEAR},
         "linear, as asked for",
         NULL,
         0.5,
         0},
        {{12, 0, 16, FALSE, .told = &untold}, "linear, assumed for 16 bits", NULL, 0.5, 0},
        {{12, 0, 16, TRUE, .told = &untold}, "linear, assumed for 16 bits", "read as sRGB", 30, 3},
        {{12, 0, 16, TRUE, .told = &srgb}, "sRGB, as the file says (PNG sRGB)", NULL, 0.5, 0},
        {{18, 6, 16, FALSE, .told = &untold}, "linear", "6 of 18 lights are dark", 90, 0},
        {{12, 0, 16, FALSE, .level = 0.0625, .told = &untold},
         "linear",
         "a constant level of 0.062",
         30,
         1},
    };
    for (gsize k = 0; k < G_N_ELEMENTS(sets); k++) {
        g_autoptr(GPtrArray) notes = g_ptr_array_new_with_free_func(g_free);
        g_autofree char *path = NULL;
        struct btf_matrix *btf = import_ball(&sets[k].ball, notes, &path);
        const double deg = normal_error(btf);
        g_test_message("set %d: normals are %.2f° off; %s", (int)k, deg,
                       find_note(notes, "warning") ? find_note(notes, "warning") : "no warning");
        g_assert_nonnull(find_note(notes, sets[k].says));
        const char *warning = find_note(notes, "warning");
        g_assert_cmpint(warning != NULL, ==, sets[k].warns != NULL);
        if (warning)
            assert_has(warning, sets[k].warns);
        g_assert_cmpfloat(deg, <=, sets[k].most_deg);
        g_assert_cmpfloat(deg, >=, sets[k].least_deg);
        btf_matrix_free(btf);
        /* check says it again. */
        g_autofree char *told = process_mesorig(0, "check %s --json", path);
        if (warning)
            assert_has(told, sets[k].warns);
        else
            g_assert_null(strstr(told, "lights are dark"));
    }
}

/* Masked pixels are holes, and what is dark next to them is not. */
TEST(masks) {
    g_autoptr(GPtrArray) notes = g_ptr_array_new_with_free_func(g_free);
    const struct ball ball = {12, 0, 8, TRUE, .masked = TRUE, .told = &untold};
    struct btf_matrix *btf = import_ball(&ball, notes, NULL);
    double n[3];
    int masked = 0;
    for (int i = 0; i < PIXELS; i++)
        masked += !normal_of(i, n);
    g_assert_cmpint(masked, >, PIXELS / 4);
    g_assert_cmpint(btf->holes, ==, 12 * masked);
    int dark = 0;
    for (int i = 0; i < PIXELS; i++)
        for (int l = 0; normal_of(i, n) && l < 12; l++) {
            double d[3], theta = (double)btf->layout.lights.theta_deg[l] * G_PI / 180,
                         phi = (double)btf->layout.lights.phi_deg[l] * G_PI / 180;
            d[0] = sin(theta) * cos(phi);
            d[1] = sin(theta) * sin(phi);
            d[2] = cos(theta);
            dark += ball_value(i, d) == 0;
            g_assert_cmpfloat_with_epsilon((double)btf->values[(i * 12 + l) * 3], ball_value(i, d),
                                           0.006);
        }
    g_assert_cmpint(dark, >, 100);
    btf_matrix_free(btf);
}

/* The only value of a picture, imported. */
static double imported(const char *file, enum picture_tones transfer, GPtrArray *notes,
                       gint64 *ret_holes, GError **error) {
    g_autofree char *dir = g_path_get_dirname(file), *base = g_path_get_basename(file);
    g_autofree char *list = g_build_filename(dir, "one.lp", NULL);
    g_autofree char *text = g_strdup_printf("%s 0 0 1\n", base),
                    *path = session_fixture_path("one");
    const struct import_wish wish = {.transfer = transfer, .notes = notes};
    struct import_result result;
    g_assert_true(g_file_set_contents(list, text, -1, NULL));
    if (!import_rti(path, list, &wish, &quietly, &result, error))
        return NAN;
    struct btf_matrix *btf = btf_matrix_read(path, NULL, error);
    const double value = (double)btf->values[0];
    if (ret_holes)
        *ret_holes = btf->holes;
    btf_matrix_free(btf);
    return value;
}

TEST(tones) {
    static const guint8 gama[4] = {0, 0, 0xb1, 0x8f},
                        cicp[4][4] = {{1, 13, 0, 1}, {1, 8, 0, 1}, {1, 1, 0, 1}, {9, 16, 0, 1}};
    static const struct {
        const char *kind;
        struct told told;
        double light; /* of 0.5; NAN: refused */
        const char *says;
    } files[] = {
        {"png", {0}, -1, "sRGB, assumed for 8 bits"},
        {"png", {.png_chunk = "gAMA", .chunk = gama, .chunk_bytes = 4}, 2.2, "PNG gAMA 0.45455"},
        {"png", {.png_chunk = "cICP", .chunk = cicp[0], .chunk_bytes = 4}, -1, "PNG cICP 13"},
        {"png", {.png_chunk = "cICP", .chunk = cicp[1], .chunk_bytes = 4}, 1, "PNG cICP 8"},
        {"png", {.png_chunk = "cICP", .chunk = cicp[2], .chunk_bytes = 4}, -2, "PNG cICP 1"},
        {"png",
         {.png_chunk = "cICP", .chunk = cicp[3], .chunk_bytes = 4},
         (double)NAN,
         "tone curve (PNG cICP 16) is not supported"},
        {"png", {.icc_gamma = 1}, 1, "linear, as the file says (ICC profile"},
        {"png", {.icc_gamma = 1.8}, 1.8, "by a curve, as the file says (ICC profile"},
        {"jpg", {0}, -1, "sRGB, assumed for 8 bits"},
        {"jpg", {.colour_space = 1}, -1, "sRGB, as the file says (EXIF sRGB)"},
        {"jpg", {.colour_space = 2}, 2.19921875, "EXIF Adobe RGB"},
        {"jpg", {.icc_gamma = 1.8, .colour_space = 1}, 1.8, "by a curve, as the file says (ICC"},
        {"tif", {0}, -1, "sRGB, assumed for 8 bits"},
        {"tif", {.icc_gamma = 1}, 1, "linear, as the file says (ICC profile"},
    };
    for (gsize k = 0; k < G_N_ELEMENTS(files); k++) {
        g_autoptr(GPtrArray) notes = g_ptr_array_new_with_free_func(g_free);
        g_autoptr(GError) error = NULL;
        g_autofree char *dir = session_fixture_new_folder();
        g_autofree char *file = g_strdup_printf("%s/one.%s", dir, files[k].kind);
        guint16 codes[64 * 3];
        guint8 bytes[64 * 3];
        for (int i = 0; i < 64 * 3; i++)
            codes[i] = bytes[i] = 128;
        if (g_str_equal(files[k].kind, "png"))
            told_png(file, 8, 8, 3, 8, codes, &files[k].told);
        else if (g_str_equal(files[k].kind, "jpg"))
            told_jpeg(file, 8, 8, bytes, &files[k].told);
        else
            told_tiff(file, 8, 8, 3, bytes, &files[k].told);
        const double v = 128 / 255.0, power = files[k].light;
        const double truth = power == -1   ? decode(v)
                             : power == -2 ? pow((v + 0.099) / 1.099, 1 / 0.45)
                                           : pow(v, power);
        const double got = imported(file, PICTURE_TONES_UNSAID, notes, NULL, &error);
        if (isnan(power)) {
            g_assert_nonnull(error);
            assert_has(error->message, files[k].says);
            g_clear_error(&error);
        } else {
            g_assert_no_error(error);
            g_assert_cmpfloat_with_epsilon(got, truth, 1e-3);
            g_assert_nonnull(find_note(notes, files[k].says));
        }
        g_assert_cmpfloat_with_epsilon(imported(file, PICTURE_TONES_LINEAR, notes, NULL, &error), v,
                                       1e-3);
        g_assert_no_error(error);
    }
}

/* The opacity of PNG and TIFF of 8 and 16 bits, in grey and in colour. */
TEST(opacity) {
    for (int k = 0; k < 4; k++) {
        static const int bits[] = {8, 16, 8, 8}, channels[] = {4, 4, 2, 4};
        g_autofree char *dir = session_fixture_new_folder();
        g_autofree char *file = g_build_filename(dir, k == 3 ? "one.tif" : "one.png", NULL);
        guint16 codes[64 * 4];
        guint8 bytes[64 * 4];
        gint64 holes = 0;
        const int n = channels[k], white = (1 << bits[k]) - 1;
        for (int i = 0; i < 64 * n; i++) {
            const gboolean opacity = i % n == n - 1, hole = i / n >= 40;
            codes[i] = (guint16)(opacity ? (hole ? 0 : white) : hole ? 0 : white);
            bytes[i] = (guint8)codes[i];
        }
        if (k == 3)
            told_tiff(file, 8, 8, 4, bytes, NULL);
        else
            told_png(file, 8, 8, n, bits[k], codes, NULL);
        const double value = ok(imported(file, PICTURE_TONES_UNSAID, NULL, &holes, ERR));
        g_assert_cmpfloat_with_epsilon(value, 1, 1e-3);
        g_assert_cmpint(holes, ==, 24);
    }
}

/* EXR whose windows differ. The file's pixels are 4 × 3; a display window is patched in. */
static void write_window(const char *path, const gint32 window[4], const char *layer,
                         const char *integers) {
    g_autofree char *r = g_strconcat(layer, "R", NULL), *g = g_strconcat(layer, "G", NULL);
    g_autofree char *b = g_strconcat(layer, "B", NULL);
    const char *channels[] = {b, g, r, integers, NULL};
    g_autoptr(ExrFile) file = exr_file_new();
    struct exr_part *part = exr_part_new("rgb", 4, 3, channels, EXR_FLOAT);
    for (int c = 0; c < part->n_channels; c++)
        for (int i = 0; i < 12; i++) {
            const guint32 number = (guint32)i;
            part->planes[c][i] = 0.25F + 0.0625F * (float)i;
            if (c == 3)
                memcpy(&part->planes[c][i], &number, sizeof number);
        }
    exr_file_add(file, part);
    g_assert_true(exr_write(path, file, EXR_NONE, FALSE, NULL));
    g_autofree char *bytes = NULL;
    gsize length;
    g_assert_true(g_file_get_contents(path, &bytes, &length, NULL));
    static const char name[] = "displayWindow\0box2i\0\x10\0\0";
    char *at = memmem(bytes, length, name, sizeof name);
    g_assert_nonnull(at);
    for (int i = 0; window && i < 4; i++)
        memcpy(at + sizeof name + 4 * i, &window[i], 4);
    if (integers) {
        at = memmem(bytes, length, integers, strlen(integers) + 1);
        at[strlen(integers) + 1] = 0; /* the type FLOAT becomes UINT */
    }
    g_assert_true(g_file_set_contents(path, bytes, (gssize)length, NULL));
}

TEST(windows) {
    static const gint32 wide[4] = {-1, -2, 4, 3}, narrow[4] = {1, 1, 2, 5},
                        away[4] = {9, 9, 12, 12};
    g_autoptr(GError) error = NULL;
    g_autofree char *dir = session_fixture_new_folder(),
                    *path = g_build_filename(dir, "a.exr", NULL);
    write_window(path, wide, "", NULL);
    g_autoptr(ExrPart) part = exr_read_picture(path, &error);
    g_assert_no_error(error);
    g_assert_cmpint(part->width, ==, 6);
    g_assert_cmpint(part->height, ==, 6);
    g_assert_cmpint(part->outside, ==, 24);
    for (int i = 0; i < 36; i++) {
        const int x = i % 6 - 1, y = i / 6 - 2;
        const float value = part->planes[0][i];
        if (x < 0 || y < 0 || x >= 4 || y >= 3)
            g_assert_true(isnan(value));
        else
            g_assert_cmpfloat((double)value, ==, 0.25 + 0.0625 * (4 * y + x));
    }
    write_window(path, narrow, "", NULL);
    g_autoptr(ExrPart) cut = exr_read_picture(path, &error);
    g_assert_no_error(error);
    g_assert_cmpint(cut->width, ==, 2);
    g_assert_cmpint(cut->height, ==, 5);
    g_assert_cmpfloat((double)cut->planes[0][0], ==, 0.25 + 0.0625 * 5);
    g_assert_cmpfloat((double)cut->planes[0][3], ==, 0.25 + 0.0625 * 10);
    g_assert_true(isnan(cut->planes[0][4]));
    write_window(path, away, "", NULL);
    g_assert_null(exr_read_picture(path, &error));
    assert_has(error->message, "lie outside of its display window; save");
}

/* Pictures cropped differently are not stacked. */
TEST(cropped) {
    static const gint32 one[4] = {0, 0, 3, 2}, other[4] = {1, 0, 4, 2}, full[4] = {-1, -1, 4, 3};
    g_autoptr(GError) error = NULL;
    g_autofree char *dir = session_fixture_new_folder(), *path = session_fixture_path("cropped");
    g_autofree char *a = g_build_filename(dir, "a.exr", NULL),
                    *b = g_build_filename(dir, "b.exr", NULL);
    g_autofree char *list = g_build_filename(dir, "two.lp", NULL);
    const struct import_wish wish = {0};
    struct import_result result;
    g_assert_true(g_file_set_contents(list, "a.exr 0 0 1\nb.exr 0 0.5 0.866\n", -1, NULL));
    write_window(a, one, "", NULL);
    write_window(b, other, "", NULL);
    g_assert_false(import_rti(path, list, &wish, &quietly, &result, &error));
    assert_has(error->message, "they show different parts of the scene");
    g_clear_error(&error);
    write_window(a, full, "", NULL);
    write_window(b, full, "", NULL);
    ok(import_rti(path, list, &wish, &quietly, &result, ERR));
    g_assert_cmpint(result.width, ==, 6);
    g_assert_cmpint(result.holes, ==, 2 * (30 - 12));
}

/* Pictures of a diffuse plane under near lamps, given as positions or as directions and a distance.
 * Each picture is a (h / r) (R / r)² cosⁿ α, with the way (x, y, h) from the texel to the lamp and
 * its length r, and R the distance of the lamps from the middle. The import leaves a h / r. */
TEST(near_lamps) {
    enum { N = 5 };
    const double texel_mm = 10, far_mm = 60;
    for (int exponent = -1; exponent <= 1; exponent++) {
        g_autofree char *dir = session_fixture_new_folder(), *path = session_fixture_path("near");
        g_autofree char *list = g_build_filename(dir, exponent < 0 ? "dome.lp" : "dome.csv", NULL);
        g_autoptr(GString) text =
            g_string_new(exponent < 0 ? "" : "name,x_mm,y_mm,z_mm,exponent\n");
        double lamps[N][3];
        for (int k = 0; k < N; k++) {
            g_autofree char *name = g_strdup_printf("p%d.exr", k);
            g_autofree char *file = g_build_filename(dir, name, NULL);
            static const char *const bgr[] = {"B", "G", "R", NULL};
            g_autoptr(ExrFile) exr = exr_file_new();
            struct exr_part *part = exr_part_new("picture", 4, 3, bgr, EXR_FLOAT);
            light_of(k, N, lamps[k]);
            exr_file_add(exr, part);
            g_string_append_printf(text, exponent < 0 ? "%s %.9f %.9f %.9f\n" : "%s,%.9f,%.9f,%.9f",
                                   name, (exponent < 0 ? 1 : far_mm) * lamps[k][0],
                                   (exponent < 0 ? 1 : far_mm) * lamps[k][1],
                                   (exponent < 0 ? 1 : far_mm) * lamps[k][2]);
            if (exponent >= 0)
                g_string_append_printf(text, ",%d\n", exponent);
            for (int i = 0; i < 12; i++) {
                const double px = (i % 4 - 1.5) * texel_mm, py = (1 - (int)(i / 4)) * texel_mm;
                const double x = far_mm * lamps[k][0] - px, y = far_mm * lamps[k][1] - py,
                             h = far_mm * lamps[k][2], r = sqrt(x * x + y * y + h * h);
                const double cosine =
                    (r * r + far_mm * far_mm - px * px - py * py) / (2 * r * far_mm);
                for (int c = 0; c < 3; c++)
                    part->planes[c][i] =
                        (float)((0.1 + 0.1 * c) * h / r * far_mm * far_mm / (r * r) *
                                pow(cosine, exponent < 0 ? 0 : exponent));
            }
            ok(exr_write(file, exr, EXR_ZIP, TRUE, ERR));
        }
        g_assert_true(g_file_set_contents(list, text->str, -1, NULL));
        const struct import_wish wish = {.texel_mm = texel_mm,
                                         .lamp_mm = exponent < 0 ? far_mm : 0};
        struct import_result result;
        ok(import_rti(path, list, &wish, &quietly, &result, ERR));
        struct btf_matrix *btf = ok(btf_matrix_read(path, NULL, ERR));
        struct near_field *near = ok(near_field_read(path, ERR));
        g_assert_null(near->camera_mm);
        for (int l = 0; l < N; l++) {
            int k = 0; /* the lights of the session are sorted */
            for (int other = 0; other < N; other++)
                if (vec3_length(vec3_sub(near->lamp_mm[l],
                                         vec3(far_mm * lamps[other][0], far_mm * lamps[other][1],
                                              far_mm * lamps[other][2]))) < 1e-3)
                    k = other;
            g_assert_cmpfloat(near->lamp_exponent[l], ==, MAX(exponent, 0));
            for (int i = 0; i < 12; i++) {
                const double x = far_mm * lamps[k][0] - (i % 4 - 1.5) * texel_mm,
                             y = far_mm * lamps[k][1] - (1 - (int)(i / 4)) * texel_mm,
                             h = far_mm * lamps[k][2], r = sqrt(x * x + y * y + h * h);
                const struct vec3 to = near_field_light(near, 0, l, i);
                g_assert_cmpfloat_with_epsilon(to.x, x / r, 1e-6);
                g_assert_cmpfloat_with_epsilon(to.y, y / r, 1e-6);
                g_assert_cmpfloat_with_epsilon((double)btf->values[(i * N + l) * 3 + 2],
                                               0.1 * h / r, 1e-3 * 0.1);
            }
        }
        near_field_free(near);
        btf_matrix_free(btf);
    }
}

/* A map of the surroundings that is cropped would be stretched over the whole sphere. */
TEST(environment) {
    static const gint32 wide[4] = {-1, 0, 4, 2}, beyond[4] = {0, 0, 3, 1};
    g_autoptr(GError) error = NULL;
    g_autofree char *dir = session_fixture_new_folder(),
                    *path = g_build_filename(dir, "sky.exr", NULL);
    write_window(path, wide, "", NULL);
    g_assert_null(environment_read(path, &error));
    assert_has(error->message, "it is cropped: its data window is smaller");
    g_clear_error(&error);
    write_window(path, beyond, "", NULL);
    struct environment *sky = ok(environment_read(path, ERR));
    g_assert_cmpint(sky->width, ==, 4);
    g_assert_cmpint(sky->height, ==, 2);
    environment_free(sky);
}

TEST(channels) {
    g_autoptr(GError) error = NULL;
    g_autofree char *dir = session_fixture_new_folder(),
                    *path = g_build_filename(dir, "a.exr", NULL);
    write_window(path, NULL, "", "id");
    g_assert_cmpfloat(imported(path, PICTURE_TONES_UNSAID, NULL, NULL, &error), ==, 0.25);
    g_autoptr(ExrFile) file = exr_read(path, &error);
    g_assert_no_error(error);
    g_assert_cmpfloat((double)exr_part_plane(file->parts->pdata[0], "id")[7], ==, 7);
    write_window(path, NULL, "ViewLayer.Combined.", NULL);
    g_assert_cmpfloat(imported(path, PICTURE_TONES_UNSAID, NULL, NULL, &error), ==, 0.25);
    g_assert_no_error(error);
}

/* Writes 4 grey pictures whose brightness is 1/4 … 4/4 in the order in which they were taken. */
static void write_series(const char *dir, const char *const names[4], const char *const taken[4]) {
    for (int k = 0; k < 4; k++) {
        g_autofree char *path = g_build_filename(dir, names[k], NULL);
        guint16 codes[64];
        const struct told told = {.taken = taken ? taken[k] : NULL,
                                  .fraction = taken ? "50" : NULL};
        for (int i = 0; i < 64; i++)
            codes[i] = (guint16)(16383 * (k + 1));
        told_png(path, 8, 8, 1, 16, codes, &told);
    }
}

/* The values under lights at θ of 10°, 20°, 30° and 40°, in quarters of white, as digits. */
static char *order_of(const char *list, GPtrArray *notes, GError **error) {
    g_autofree char *path = session_fixture_path("order");
    const struct import_wish wish = {.notes = notes};
    struct import_result result;
    if (!import_rti(path, list, &wish, &quietly, &result, error))
        return NULL;
    struct btf_matrix *btf = btf_matrix_read(path, NULL, error);
    GString *digits = g_string_new(NULL);
    for (gsize l = 0; l < btf->layout.lights.n; l++)
        g_string_append_printf(digits, "%.0f", 4 * (double)btf->values[l * 3]);
    btf_matrix_free(btf);
    return g_string_free(digits, FALSE);
}

TEST(order) {
    static const char *const wrapped[4] = {"DSC_9998.png", "DSC_9999.png", "DSC_0001.png",
                                           "DSC_0002.png"};
    static const char *const taken[4] = {"2026:11:27 18:57:58", "2026:11:27 18:57:59",
                                         "2026:11:27 18:58:00", "2026:11:27 18:58:01"};
    static const char *const plain[4] = {"DSC_0997.png", "DSC_0998.png", "DSC_1001.png",
                                         "DSC_1002.png"};
    static const char lights[] = "theta,phi\n10,0\n20,0\n30,0\n40,0\n";
    g_autofree char *dir = session_fixture_new_folder(), *other = session_fixture_new_folder();
    g_autofree char *list = g_build_filename(dir, "lights.csv", NULL);
    g_autofree char *beside = g_build_filename(other, "lights.csv", NULL);
    g_autofree char *named = g_build_filename(other, "filenames.txt", NULL);
    g_autofree char *hidden = g_build_filename(other, "._DSC_0997.png", NULL);
    g_autoptr(GPtrArray) notes = g_ptr_array_new_with_free_func(g_free);
    g_autoptr(GError) error = NULL;
    g_assert_true(g_file_set_contents(list, lights, -1, NULL));
    g_assert_true(g_file_set_contents(beside, lights, -1, NULL));
    write_series(dir, wrapped, NULL);
    g_assert_null(order_of(list, notes, &error));
    assert_has(error->message, "go from DSC_0001.png to DSC_9999.png with a gap");
    g_clear_error(&error);
    write_series(dir, wrapped, taken);
    g_autofree char *by_time = ok(order_of(list, notes, ERR));
    g_assert_cmpstr(by_time, ==, "1234");
    g_assert_nonnull(find_note(notes, "sorted by their times in EXIF, from DSC_9998.png"));
    /* A gap alone means nothing; nor do the files that macOS adds. */
    write_series(other, plain, NULL);
    g_assert_true(g_file_set_contents(hidden, "no picture", -1, NULL));
    g_autofree char *by_name = ok(order_of(beside, notes, ERR));
    g_assert_cmpstr(by_name, ==, "1234");
    g_assert_true(g_file_set_contents(named,
                                      "\xef\xbb\xbf"
                                      "DSC_1002.png\rDSC_1001.png\rDSC_0998.png\r"
                                      "DSC_0997.png\r",
                                      -1, NULL));
    g_autofree char *by_list = ok(order_of(beside, notes, ERR));
    g_assert_cmpstr(by_list, ==, "4321");
}

/* Lists of lights from other programs and other countries. */
TEST(lists) {
    static const char *const names[4] = {"a.png", "b.png", "c.png", "d.png"};
    static const char *const forms[] = {
        "4\na.png 0,17365 0 0,98481\nb.png 0,34202 0,0 0,93969\nc.png 0,5 0 0,86603\n"
        "d.png 0,64279 0 0,76604\n",
        "4\ra.png 0.17365 0 0.98481\rb.png 0.34202 0 0.93969\rc.png 0.5 0 0.86603\r"
        "d.png 0.64279 0 0.76604\r",
        "a.png;0,17365;0;0,98481\nb.png;0,34202;0;0,93969\nc.png;0,5;0;0,86603\n"
        "d.png;0,64279;0;0,76604\n",
        "image;theta;phi\na.png;10,0;0\nb.png;20,0;0\nc.png;30,0;0\nd.png;40,0;0\n",
        "5\na.png 0.17365 0 0.98481\nb.png 0.34202 0 0.93969\nc.png 0.5 0 0.86603\n"
        "d.png 0.64279 0 0.76604\na.png 1 0 -0.001\n",
        "4\njpeg\\a.png 0.17365 0 0.98481\njpeg/b.png 0.34202 0 0.93969\n"
        "jpeg/c.png 0.5 0 0.86603\nelsewhere/d.png 0.64279 0 0.76604\n",
    };
    g_autofree char *dir = session_fixture_new_folder(),
                    *list = g_build_filename(dir, "set.lp", NULL);
    g_autofree char *below = g_build_filename(dir, "jpeg", NULL);
    g_assert_cmpint(g_mkdir(below, 0700), ==, 0);
    write_series(dir, names, NULL);
    for (gsize i = 0; i < G_N_ELEMENTS(forms); i++) {
        g_autoptr(GPtrArray) notes = g_ptr_array_new_with_free_func(g_free);
        g_autoptr(GError) error = NULL;
        if (i + 1 == G_N_ELEMENTS(forms)) { /* pictures of another brightness are not taken */
            static const char *const turned[4] = {"d.png", "c.png", "b.png", "a.png"};
            static const char *const left[4] = {"z.png", "c.png", "b.png", "a.png"};
            write_series(below, names, NULL);
            write_series(dir, turned, NULL);
            write_series(dir, left, NULL);
        }
        g_assert_true(g_file_set_contents(list, forms[i], -1, NULL));
        g_autofree char *order = ok(order_of(list, notes, ERR));
        g_assert_cmpstr(order, ==, i + 1 == G_N_ELEMENTS(forms) ? "1231" : "1234");
        g_assert_cmpint(find_note(notes, "set.lp:6: ") != NULL, ==, i == 4);
    }
    g_autoptr(GError) error = NULL;
    g_assert_true(g_file_set_contents(list, "filenam,theta,phi\na.png,1,0\n", -1, NULL));
    g_assert_null(order_of(list, NULL, &error));
    assert_has(error->message, "set.lp:1: column “filenam” is not known; did you mean filename?");
}

TESTS_RUN_BY(session_fixture_run);
