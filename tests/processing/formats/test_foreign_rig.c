/*
 * Pictures of somebody else's rig, made by the formulas of lib/foreign_rig.h, through “mesorig
 * import poses” and “mesorig process”. The BTF of a matt print is known: ρ cos θ_l of each texel.
 */
#include "btf/btf.h"
#include "formats/import_poses.h"
#include "formats/nominal.h"

#include "lib/foreign_rig.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/session_fixture.h"
#include "lib/test.h"
#include "lib/told_pictures.h"
#include "lib/write_dng.h"

#define TEXELS   24
#define WIDTH_MM 36.0
#define DEGREE   (G_PI / 180)
#define HEAD     "file,camera,lamp,turntable_deg,arc_deg,exposure_ms\n"
#define ROUNDED  0.002 /* relative, of a half float that was made of half floats */
#define PLANE_MM 4.0

static const struct work quietly = {0};
static const struct session_grid grid = {TEXELS, TEXELS, WIDTH_MM, WIDTH_MM, PLANE_MM, 5};
static const struct pinhole camera = {96, 96, 30 * DEGREE, 650, 1100};
static const struct arc_lamp lamp = {40 * DEGREE, 500, 400};

static double vignetting;

/* Lamps that stand around the turntable, not quite a quarter of a turn apart. */
#define LAMPS 4
static const double azimuths_deg[LAMPS] = {0, 90.4, 180, 269.7};

/* The rig, as its builder would write it down: without distortion. */
static char *write_nominal(const char *dir) {
    struct rig rig = {.id = "foreign", .n_cameras = 1, .n_lamps = 1 + LAMPS};
    rig.arc_radius_mm = 600;
    rig.cameras[0] = pinhole_to_rig(&camera, "cam");
    rig.cameras[0].vignetting = vignetting;
    rig.lamps[0] = arc_lamp_to_rig(&lamp, "lamp");
    for (int i = 1; i <= LAMPS; i++) {
        const double a = azimuths_deg[i - 1] * DEGREE;
        g_autofree char *name = g_strdup_printf("lamp%d", i);
        rig.lamps[i] = arc_lamp_to_rig(&lamp, name);
        rig.lamps[i].position_mm =
            vec3(lamp.distance_mm * sin(lamp.theta) * cos(a),
                 lamp.distance_mm * sin(lamp.theta) * sin(a), lamp.distance_mm * cos(lamp.theta));
    }
    g_autofree char *text = rig_to_text(&rig);
    char *path = g_build_filename(dir, "nominal.conf", NULL);
    g_assert_true(g_file_set_contents(path, text, -1, NULL));
    return path;
}

static void write_exr(const char *dir, const char *name, const float *planes, int n_planes) {
    static const char *const grey[] = {"Y", NULL}, *const bgr[] = {"B", "G", "R", NULL};
    const int n = camera.width * camera.height;
    g_autofree char *path = g_build_filename(dir, name, NULL);
    g_autoptr(ExrFile) file = exr_file_new();
    struct exr_part *part =
        exr_part_new("picture", camera.width, camera.height, n_planes == 1 ? grey : bgr, EXR_FLOAT);
    for (int c = 0; c < n_planes; c++)
        memcpy(part->planes[n_planes - 1 - c], planes + c * n, sizeof(float) * (gsize)n);
    exr_file_add(file, part);
    g_assert_true(exr_write(path, file, EXR_NONE, FALSE, NULL));
}

static double same_light_deg;
static const char *cfa = "mono";
static gboolean target;
static struct import_poses_result result;

/* Imports a table's rows next to the pictures in a folder. */
static gboolean import_rows(const char *dir, const char *rows, const char *path, GError **error) {
    g_autofree char *table = g_build_filename(dir, "poses.csv", NULL);
    g_autofree char *nominal = write_nominal(dir);
    const struct import_poses poses = {.table = table,
                                       .calibration = nominal,
                                       .cfa = cfa,
                                       .grid = grid,
                                       .threshold_dn = 40,
                                       .same_light_deg = same_light_deg,
                                       .target = target};
    g_assert_true(g_file_set_contents(table, rows, -1, NULL));
    return import_poses(path, &poses, &quietly, &result, error);
}

/* A processed session; g_free(). */
static char *session_of(const char *dir, const char *rows) {
    static int number;
    g_autofree char *name = g_strdup_printf("s%d", number++);
    char *path = session_fixture_path(name);
    ok(import_rows(dir, rows, path, ERR));
    g_free(process_mesorig(0, "process %s --json", path));
    return path;
}

/* The part of view 0 and light 0. */
static struct exr_part *btf_of(const char *dir, const char *rows) {
    g_autofree char *path = session_of(dir, rows);
    g_autofree char *file = g_build_filename(path, "products/btf/view_0000.exr", NULL);
    struct exr_part *part = ok(exr_read_part(file, "light_0000", ERR));
    return part;
}

/* cos θ of the lamp over a point of the print, for a turntable at 0. */
static double lamp_cosine(double x_mm, double y_mm) {
    const double l[3] = {lamp.distance_mm * sin(lamp.theta) - x_mm, -y_mm,
                         lamp.distance_mm * cos(lamp.theta) - PLANE_MM};
    return l[2] / sqrt(analytic_dot(l, l));
}

/* The point of the middle of texel i. */
static void middle_of(int i, double *ret_x, double *ret_y) {
    const int column = i % TEXELS, row = i / TEXELS;
    *ret_x = (column + 0.5) * WIDTH_MM / TEXELS - WIDTH_MM / 2;
    *ret_y = WIDTH_MM / 2 - (row + 0.5) * WIDTH_MM / TEXELS;
}

#define SLOPE 0.15 /* of the edge: dx/dy */
static const double left_of[3] = {0.2, 0.7, 0.1}, right_of[3] = {0.8, 0.3, 0.6};

static double edge_at(double y_mm) {
    return 1.3 + SLOPE * y_mm;
}

static double edge_print(double x_mm, double y_mm, int c) {
    return x_mm < edge_at(y_mm) ? left_of[c] : right_of[c];
}

static double smooth_print(double x_mm, double y_mm, int c) {
    return 0.4 + 0.2 * sin(0.3 * x_mm + c) * cos(0.25 * y_mm);
}

static float *render(double (*print)(double, double, int), double exposure_ms) {
    const struct foreign_scene scene = {.plane_mm = PLANE_MM, .print = print};
    const struct foreign_shot shot = {&camera, &lamp, 0, 0, exposure_ms, 16};
    return foreign_render(&scene, &shot);
}

/* Where the edge is in a row of texels: of each the share that has the value of the left side,
 * v = ρ cos θ, counts as its width. */
static double edge_of_row(const float *values, int row, int c) {
    const double texel_mm = WIDTH_MM / TEXELS, y = WIDTH_MM / 2 - (row + 0.5) * texel_mm;
    double edge = -WIDTH_MM / 2;
    for (int i = 0; i < TEXELS; i++) {
        const double x = -WIDTH_MM / 2 + (i + 0.5) * texel_mm;
        const double rho = (double)values[row * TEXELS + i] / lamp_cosine(x, y);
        edge += texel_mm * (rho - right_of[c]) / (left_of[c] - right_of[c]);
    }
    return edge;
}

/* A sharp edge of two colours lies where it was printed, in each channel. A pixel is 0.6 mm. */
TEST(edge) {
    g_autofree char *dir = session_fixture_new_folder();
    g_autofree float *planes = render(edge_print, 1);
    static const char *const names[] = {"R", "G", "B"};
    double worst = 0, apart = 0;
    write_exr(dir, "edge.exr", planes, 3);
    g_autoptr(ExrPart) part = btf_of(dir, HEAD "edge.exr,cam,lamp,0,0,1\n");
    for (int row = 0; row < TEXELS; row++) {
        const double wanted = edge_at(WIDTH_MM / 2 - (row + 0.5) * WIDTH_MM / TEXELS);
        double at[3];
        for (int c = 0; c < 3; c++) {
            at[c] = edge_of_row(exr_part_plane(part, names[c]), row, c);
            worst = MAX(worst, fabs(at[c] - wanted));
        }
        apart = MAX(apart, MAX(fabs(at[0] - at[1]), fabs(at[2] - at[1])));
    }
    g_test_message("edge: at most %.4f mm off, channels at most %.4f mm apart", worst, apart);
    g_assert_cmpfloat(worst, <, 0.02);
    g_assert_cmpfloat(apart, <, 0.02);
}

/* A picture whose channels are equal gives what the grey picture gives, and a picture in colour
 * what its formula says. */
TEST(grey) {
    g_autofree char *dir = session_fixture_new_folder();
    g_autofree float *planes = render(smooth_print, 1);
    const gsize n = (gsize)camera.width * (gsize)camera.height;
    static const char *const names[] = {"R", "G", "B"};
    write_exr(dir, "colour.exr", planes, 3);
    g_autoptr(ExrPart) colour = btf_of(dir, HEAD "colour.exr,cam,lamp,0,0,1\n");
    for (int c = 0; c < 3; c++) {
        g_autofree float *equal = g_new(float, 3 * n);
        const float *const seen = exr_part_plane(colour, names[c]);
        for (gsize k = 0; k < 3; k++)
            memcpy(equal + k * n, planes + (gsize)c * n, sizeof(float) * n);
        write_exr(dir, "equal.exr", equal, 3);
        write_exr(dir, "grey.exr", equal, 1);
        g_autoptr(ExrPart) a = btf_of(dir, HEAD "equal.exr,cam,lamp,0,0,1\n");
        g_autoptr(ExrPart) b = btf_of(dir, HEAD "grey.exr,cam,lamp,0,0,1\n");
        for (int i = 0; i < TEXELS * TEXELS; i++) {
            double x, y;
            middle_of(i, &x, &y);
            const double wanted = smooth_print(x, y, c) * lamp_cosine(x, y);
            g_assert_cmpfloat_with_epsilon((double)seen[i], wanted, 0.003);
            for (int k = 0; k < 3; k++) {
                const double grey = (double)exr_part_plane(b, names[k])[i];
                g_assert_cmpfloat_with_epsilon((double)exr_part_plane(a, names[k])[i], grey,
                                               ROUNDED * grey);
                g_assert_cmpfloat_with_epsilon((double)seen[i], grey, ROUNDED * grey);
            }
        }
    }
}

/* A picture in which green is too bright left of the edge: there the BTF has lower bounds, grey or
 * in colour, and nowhere else. */
TEST(saturated) {
    g_autofree char *dir = session_fixture_new_folder();
    g_autofree float *planes = render(edge_print, 3);
    const int n = camera.width * camera.height;
    for (int i = 0; i < 3 * n; i++)
        planes[i] = MIN(planes[i] * (i / n == 1 ? 1 : 0.3f), 1.0f);
    write_exr(dir, "colour.exr", planes, 3);
    write_exr(dir, "grey.exr", planes + n, 1);
    static const char *const rows[] = {HEAD "colour.exr,cam,lamp,0,0,3\n",
                                       HEAD "grey.exr,cam,lamp,0,0,3\n"};
    for (gsize k = 0; k < G_N_ELEMENTS(rows); k++) {
        g_autoptr(ExrPart) part = btf_of(dir, rows[k]);
        const float *mark = exr_part_plane(part, "mark");
        g_assert_nonnull(mark);
        for (int i = 0; i < TEXELS * TEXELS; i++) {
            double x, y;
            middle_of(i, &x, &y);
            if (fabs(x - edge_at(y)) > 2) /* the edge itself lies in a texel and its pixels */
                g_assert_cmpint((int)mark[i], ==, x < edge_at(y) ? BTF_FLAG_BOUND : 0);
        }
    }
}

/* How a picture is coded in a PNG: n = round(black + T⁻¹(v · flat) · (white − black)). */
static const struct coding {
    const char *columns, *values;
    int bits, file_bits, black;
    gboolean srgb;
    double falls; /* the flat field is 1 − falls · (r / half the width)², r from the middle */
    int columns_differ; /* every second eight columns have this number more, also without light */
} codings[] = {
    {"", "", 8, 8, 0, TRUE, 0},
    {"", "", 16, 16, 0, FALSE, 0},
    {",transfer", ",linear", 8, 8, 0, FALSE, 0},
    {",transfer", ",srgb", 16, 16, 0, TRUE, 0},
    {",black_level", ",4096", 16, 16, 4096, FALSE, 0},
    {",bits,black_level", ",12,256", 12, 16, 256, FALSE, 0},
    {",bits,black_level,transfer", ",14,64,srgb", 14, 16, 64, TRUE, 0},
    {",flat_field", ",flat.png", 16, 16, 0, FALSE, 0.4},
    {",flat_field,bits,black_level", ",flat.png,12,200", 12, 16, 200, FALSE, 0.25},
    {",flat_field,transfer", ",flat.png,srgb", 8, 8, 0, TRUE, 0.3},
    {",dark_frame", ",dark.png", 16, 16, 3000, FALSE, 0, 1200},
    {",dark_frame,bits", ",dark.png,12", 12, 16, 200, FALSE, 0, 100},
    {",dark_frame,transfer", ",dark.png,srgb", 16, 16, 2000, TRUE, 0, 900},
    {",dark_frame,flat_field", ",dark.png,flat.png", 16, 16, 3000, FALSE, 0.4, 1200},
};

static double fall_off(const struct coding *coding, int pixel) {
    const int column = pixel % camera.width, row = pixel / camera.width;
    const double x = column - 0.5 * (camera.width - 1), y = row - 0.5 * (camera.height - 1);
    return 1 - coding->falls * (x * x + y * y) / (0.25 * camera.width * camera.width);
}

/* planes NULL: the flat field, which is light (0.5) times as bright as white in red, and less in
 * the others. */
static void write_coded(const struct coding *coding, const char *dir, const char *name,
                        const float *planes, double light) {
    const int n = camera.width * camera.height, white = (1 << coding->bits) - 1;
    g_autofree guint16 *codes = g_new(guint16, 3 * n);
    g_autofree char *path = g_build_filename(dir, name, NULL);
    for (int i = 0; i < 3 * n; i++) {
        const double v = fall_off(coding, i / 3) *
                         (planes ? (double)planes[i % 3 * n + i / 3] : light / (1 + i % 3));
        const double s = v <= 0.0031308 ? 12.92 * v : 1.055 * pow(v, 1 / 2.4) - 0.055;
        const int more = i / 3 % camera.width / 8 % 2 == 0 ? 0 : coding->columns_differ;
        const double mean_black = coding->black + 0.5 * coding->columns_differ;
        codes[i] =
            (guint16)lround(coding->black + more + (coding->srgb ? s : v) * (white - mean_black));
    }
    foreign_write_png(path, codes, camera.width, camera.height, 3, coding->file_bits);
}

/* Whatever the coding, the BTF is what the formula says; of flat fields, for which the middle of a
 * picture is 1, up to the mean of the fall-off around it. */
static void test_coding(gconstpointer data) {
    const struct coding *coding = data;
    static const char *const names[] = {"R", "G", "B"};
    g_autofree char *dir = session_fixture_new_folder();
    g_autofree float *planes = render(smooth_print, 1);
    g_autofree char *rows =
        g_strdup_printf("file,camera,lamp%s\na.png,cam,lamp%s\n", coding->columns, coding->values);
    double sum = 0;
    write_coded(coding, dir, "a.png", planes, 0);
    write_coded(coding, dir, "flat.png", NULL, 0.5);
    write_coded(coding, dir, "dark.png", NULL, 0);
    g_autoptr(ExrPart) part = btf_of(dir, rows);
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < TEXELS * TEXELS; i++) {
            double x, y;
            middle_of(i, &x, &y);
            const double wanted = smooth_print(x, y, c) * lamp_cosine(x, y);
            const double off = (double)exr_part_plane(part, names[c])[i] - wanted;
            sum += off * off / (3 * TEXELS * TEXELS);
            g_assert_cmpfloat(fabs(off), <, coding->file_bits == 8 ? 0.009 : 0.004);
        }
    g_test_message("%s%s: RMS error %.5f of a mean of 0.3", coding->columns, coding->values,
                   sqrt(sum));
    g_assert_cmpfloat(sqrt(sum), <, coding->file_bits == 8 ? 0.003 : 0.0015);
}

/* Camera raw says its levels and its filter itself. Red pixels and blue ones are interpolated. */
static void write_raw(const char *dir, const char *name, const float *planes) {
    static const guint32 black[4] = {500, 512, 520, 530};
    const int n = camera.width * camera.height, white = 14000;
    g_autofree guint16 *values = g_new(guint16, n);
    g_autofree char *path = g_build_filename(dir, name, NULL);
    struct dng dng = {.width = camera.width, .height = camera.height, .values = values};
    for (int i = 0; i < n; i++) {
        const int cell = 2 * (i / camera.width & 1) + (i % camera.width & 1);
        const int c = cell == 0 ? 0 : cell == 3 ? 2 : 1;
        values[i] =
            (guint16)lround(black[cell] + (double)planes[c * n + i] * (white - black[cell]));
    }
    dng.cfa = "rggb";
    memcpy(dng.black, black, sizeof black);
    dng.white = (guint32)white;
    write_dng(path, &dng);
}

static void assert_refused(const char *dir, const char *rows, const char *what) {
    g_autoptr(GError) error = NULL;
    g_autofree char *path = session_fixture_path("refused");
    g_assert_false(import_rows(dir, rows, path, &error));
    g_assert_nonnull(error);
    assert_has(error->message, what);
    g_assert_false(g_file_test(path, G_FILE_TEST_EXISTS));
}

TEST(coding__raw) {
    static const char *const names[] = {"R", "G", "B"};
    g_autofree char *dir = session_fixture_new_folder();
    g_autofree float *planes = render(smooth_print, 1);
    const char *rows = "file,camera,lamp\na.dng,cam,lamp\n";
    write_raw(dir, "a.dng", planes);
    assert_refused(dir, rows, "the colour filter of a.dng is rggb, not mono; give --cfa rggb");
    assert_refused(dir, "file,camera,lamp,bits\na.dng,cam,lamp,14\n", "the colour filter of a.dng");
    cfa = "rggb";
    assert_refused(dir, "file,camera,lamp,bits\na.dng,cam,lamp,14\n",
                   "bits is 14, but a.dng contains floating-point numbers; leave bits empty");
    assert_refused(dir, "file,camera,lamp,black_level\na.dng,cam,lamp,512\n",
                   "black_level is 512, but must be below white, which is 1 in a.dng");
    g_autoptr(ExrPart) part = btf_of(dir, rows);
    cfa = "mono";
    double sum = 0;
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < TEXELS * TEXELS; i++) {
            double x, y;
            middle_of(i, &x, &y);
            const double off = (double)exr_part_plane(part, names[c])[i] -
                               smooth_print(x, y, c) * lamp_cosine(x, y);
            sum += off * off / (3 * TEXELS * TEXELS);
            g_assert_cmpfloat(fabs(off), <, 0.008);
        }
    g_test_message("camera raw: RMS error %.5f of a mean of 0.3", sqrt(sum));
    g_assert_cmpfloat(sqrt(sum), <, 0.0015);
}

TEST(coding__bad) {
    g_autofree char *dir = session_fixture_new_folder(),
                    *small = g_build_filename(dir, "small.png", NULL);
    g_autofree float *planes = render(smooth_print, 1);
    const guint16 codes[3] = {1, 2, 3};
    write_exr(dir, "f.exr", planes, 3);
    write_exr(dir, "grey.exr", planes, 1);
    write_coded(&codings[0], dir, "a.png", planes, 0);
    write_coded(&codings[1], dir, "b.png", planes, 0);
    foreign_write_png(small, codes, 1, 1, 3, 8);
#define CODED(columns) "file,camera,lamp," columns "\n"
    assert_refused(dir, CODED("black_level") "a.png,cam,lamp,-1\n",
                   "poses.csv:2: a black_level of -1 is below 0");
    assert_refused(dir, CODED("black_level") "a.png,cam,lamp,x\n", "“x” in column black_level");
    assert_refused(
        dir, CODED("black_level") "a.png,cam,lamp,255\n",
        "poses.csv:2: black_level is 255, but must be below white, which is 255 in a.png");
    assert_refused(dir, CODED("black_level") "f.exr,cam,lamp,1\n",
                   "must be below white, which is 1 in f.exr");
    assert_refused(dir, CODED("exposure_ms") "a.png,cam,lamp,0.001\n",
                   "poses.csv:2: exposure_ms is 0.001, so that a.png would contain up to");
    assert_refused(dir, CODED("bits") "b.png,cam,lamp,12.5\n", "bits is 12.5; give 2 to 16");
    assert_refused(dir, CODED("bits") "b.png,cam,lamp,17\n", "bits is 17; give 2 to 16");
    assert_refused(dir, CODED("bits") "a.png,cam,lamp,12\n",
                   "bits is 12, but the numbers of a.png have 8");
    assert_refused(dir, CODED("bits") "f.exr,cam,lamp,12\n",
                   "bits is 12, but f.exr contains floating-point numbers");
    assert_refused(dir, CODED("bits") "b.png,cam,lamp,12\n",
                   "but the largest number of 12 bits is 4095");
    assert_refused(dir, CODED("transfer") "a.png,cam,lamp,gamma\n",
                   "transfer “gamma” is not known; choose from: linear, srgb");
    assert_refused(dir, CODED("flat_field") "a.png,cam,lamp,no.png\n",
                   "poses.csv:2: flat_field names the file /");
    assert_refused(dir, CODED("flat_field") "a.png,cam,lamp,small.png\n",
                   "small.png has 1 × 1 pixels, but camera cam has 96 × 96");
    assert_refused(dir, CODED("dark_frame") "a.png,cam,lamp,no.png\n",
                   "poses.csv:2: dark_frame names the file /");
    assert_refused(dir, CODED("dark_frame") "a.png,cam,lamp,b.png\n",
                   "(96 × 96 pixels, colour, 8 bits) do not match");
    assert_refused(dir, CODED("dark_frame,black_level") "a.png,cam,lamp,a.png,10\n",
                   "there are a dark_frame and a black_level of 10; leave out one of them");
    assert_refused(dir, CODED("flat_field") "grey.exr,cam,lamp,f.exr\n",
                   "grey.exr is grey, but its flat field");
    vignetting = 0.1;
    assert_refused(dir, CODED("flat_field") "a.png,cam,lamp,b.png\n",
                   "also describes the vignetting of camera cam; leave out one of them");
    vignetting = 0;
}

/* cos θ of a lamp at an azimuth of the sample frame, over a point of the print. */
static double light_cosine(double azimuth, double x_mm, double y_mm) {
    double at[3] = {lamp.distance_mm * sin(lamp.theta), 0,
                    lamp.distance_mm * cos(lamp.theta) - PLANE_MM};
    analytic_turn(at, azimuth, at);
    at[0] -= x_mm;
    at[1] -= y_mm;
    return at[2] / sqrt(analytic_dot(at, at));
}

/* Three angles of the turntable, four lamps that do not turn with it. Each texel of each view and
 * light is what the formula says of the lamp that was on, which its part names. */
TEST(turntable) {
    static const double turns_deg[] = {0, 90, 180};
    static const char *const names[] = {"R", "G", "B"};
    g_autofree char *dir = session_fixture_new_folder();
    g_autoptr(GString) rows = g_string_new("file,camera,lamp,turntable_deg\n");
    const struct foreign_scene scene = {.plane_mm = PLANE_MM, .print = smooth_print};
    for (gsize t = 0; t < G_N_ELEMENTS(turns_deg); t++)
        for (int k = 0; k < LAMPS; k++) {
            const struct foreign_shot shot = {
                &camera, &lamp, azimuths_deg[k] * DEGREE, turns_deg[t] * DEGREE, 1, 4};
            g_autofree char *name = g_strdup_printf("t%d_l%d.exr", (int)t, k);
            g_autofree float *planes = foreign_render(&scene, &shot);
            write_exr(dir, name, planes, 3);
            g_string_append_printf(rows, "%s,cam,lamp%d,%g\n", name, k + 1, turns_deg[t]);
        }
    assert_refused(dir, rows->str, "can be joined with --same-light");
    same_light_deg = 60;
    assert_refused(dir, rows->str, "give a smaller --same-light");
    same_light_deg = 1;
    g_autofree char *path = session_of(dir, rows->str);
    same_light_deg = 0;
    g_assert_cmpint(result.n_views, ==, 3);
    g_assert_cmpint(result.n_lights, ==, LAMPS);
    double worst = 0;
    for (int view = 0; view < 3; view++) {
        g_autofree char *file = g_strdup_printf("%s/products/btf/view_%04d.exr", path, view);
        g_autoptr(ExrFile) exr = exr_read(file, NULL);
        g_assert_true(exr && exr->parts->len == LAMPS);
        for (int light = 0; light < LAMPS; light++) {
            const struct exr_part *part = exr->parts->pdata[light];
            double phi_deg;
            g_assert_true(exr_get_double(part, "light.phi_deg", &phi_deg, NULL));
            /* The lamp whose place it is: the nearest in the sample frame of this view. */
            double azimuth = 0, least = 360;
            for (int k = 0; k < LAMPS; k++) {
                const double off =
                    fabs(remainder(azimuths_deg[k] - turns_deg[view] - phi_deg, 360));
                azimuth = off < least ? azimuths_deg[k] - turns_deg[view] : azimuth;
                least = MIN(least, off);
            }
            g_assert_cmpfloat(least, <, 1);
            for (int i = 0; i < 3 * TEXELS * TEXELS; i++) {
                const int texel = i / 3;
                double x, y;
                middle_of(texel, &x, &y);
                const double wanted =
                    smooth_print(x, y, i % 3) * light_cosine(azimuth * DEGREE, x, y);
                worst =
                    MAX(worst, fabs((double)exr_part_plane(part, names[i % 3])[texel] - wanted));
            }
        }
    }
    g_test_message("turntable: at most %.5f off", worst);
    g_assert_cmpfloat(worst, <, 0.004);
}

/* Pictures of a target under one lamp at several angles of the turntable make a session without a
 * BTF, with a frame a picture. */
TEST(target) {
    g_autofree char *dir = session_fixture_new_folder(), *path = session_fixture_path("target");
    g_autofree float *planes = render(smooth_print, 1);
    g_autoptr(GError) error = NULL;
    static const char *const rows = "file,camera,lamp,turntable_deg\n"
                                    "a.exr,cam,lamp,0\na.exr,cam,lamp,20\na.exr,cam,lamp,40\n";
    write_exr(dir, "a.exr", planes, 3);
    assert_refused(dir, rows, "For pictures of a calibration target");
    target = TRUE;
    import_rows(dir, rows, path, &error);
    target = FALSE;
    g_assert_no_error(error);
    g_assert_cmpint(result.n_views, ==, 3);
    g_assert_cmpint(result.n_frames, ==, 3);
}

/* The same rig in a file of nominal values. */
TEST(nominal) {
    static const char *const text = "[rig]\nid = foreign\n"
                                    "[camera cam]\nwidth = 96\nheight = 96\nfocal_px = 1100\n"
                                    "eye_mm = 325; 0; 562.9165124598851\nresponse = 6000\n"
                                    "[camera turned]\nwidth = 96\nheight = 96\nfocal_px = 1100\n"
                                    "eye_mm = 325; 0; 562.9165124598851\nturn_deg = 90\n"
                                    "[lamp lamp]\nintensity = 400\n"
                                    "position_mm = 321.3938048432697; 0; 383.0222215594890\n"
                                    "[laser laser]\nposition_mm = 300; 0; 400\naxis = 0; 2; 0\n";
    g_autoptr(GError) error = NULL;
    g_autofree char *dir = session_fixture_new_folder(),
                    *path = g_build_filename(dir, "nominal.conf", NULL);
    const struct rig_camera wanted = pinhole_to_rig(&camera, "cam");
    const struct rig_lamp lit = arc_lamp_to_rig(&lamp, "lamp");
    const struct line_laser line = {atan2(300, 400), 500};
    const struct rig_laser sheet = line_laser_to_rig(&line, "laser");
    g_assert_true(g_file_set_contents(path, text, -1, NULL));
    g_autoptr(Calibration) known = nominal_read(path, &error);
    g_assert_no_error(error);
    const struct rig *rig = &known->rig;
    g_assert_cmpint(rig->n_cameras + rig->n_lamps + rig->n_lasers, ==, 4);
    g_assert_cmpfloat_with_epsilon(vec3_length(vec3_sub(rig->lamps[0].aim, lit.aim)), 0, 1e-9);
    g_assert_cmpfloat_with_epsilon(
        vec3_length(vec3_sub(rig->lamps[0].position_mm, lit.position_mm)), 0, 1e-9);
    g_assert_cmpfloat_with_epsilon(vec3_length(vec3_sub(rig->lasers[0].normal, sheet.normal)), 0,
                                   1e-9);
    /* A point that the level camera shows at (x, y), the one turned clockwise shows at (y, 95 − x).
     */
    for (int i = 0; i < 27; i++) {
        const int column = i % 3 - 1, row = i / 3 % 3 - 1, layer = i / 9;
        const double p[3] = {10 * column, 10 * row, 10 * layer};
        double x, y, at_x, at_y, turned_x, turned_y;
        pinhole_project(&camera, p, &x, &y);
        g_assert_true(rig_project(&rig->cameras[0], vec3(p[0], p[1], p[2]), &at_x, &at_y));
        g_assert_true(rig_project(&rig->cameras[1], vec3(p[0], p[1], p[2]), &turned_x, &turned_y));
        g_assert_cmpfloat_with_epsilon(at_x, x, 1e-9);
        g_assert_cmpfloat_with_epsilon(at_y, y, 1e-9);
        g_assert_cmpfloat_with_epsilon(turned_x, y, 1e-9);
        g_assert_cmpfloat_with_epsilon(turned_y, 95 - x, 1e-9);
    }
    g_assert_cmpfloat(rig->cameras[0].response, ==, wanted.response);
}

TEST(nominal__bad) {
    static const struct {
        const char *text, *what;
    } bad[] = {
        {"[camera c]\nwidth = 9\n", "nominal.conf:1: [camera c] height: a value is missing"},
        {"[camera c]\nwidth = ?\n", "nominal.conf:2: [camera c] width: “?” is not a number"},
        {"[camera c]\nwidth = 0\n",
         "nominal.conf:2: [camera c] width: 0 is out of range: 1 to 65536"},
        {"[camera c]\nwide = 9\n",
         "nominal.conf:2: [camera c] wide: there is no such key; did you mean width?"},
        {"[camera c]\nwidth = 9\nheight = 9\nfocal_px = 9\neye_mm = 1; 2\n",
         "nominal.conf:5: [camera c] eye_mm: “1; 2” is not three numbers x; y; z"},
        {"[camera c]\nwidth = 9\nheight = 9\nfocal_px = 9\neye_mm = 0; 0; 0\n",
         "eye_mm: the point is less than 1 mm from target_mm"},
        {"[world]\n[camera c]\n", "nominal.conf:1: [world]: this section is not known"},
        {"[rig]\n[camera c]\n", "nominal.conf:1: [rig] id: the rig has no id"},
        {"[laser l]\nposition_mm = 0; 0; 9\naxis = 0; 0; 1\n[camera c]\n",
         "nominal.conf:3: [laser l] axis: 0; 0; 1 points along the line from position_mm"},
        {"[laser l]\nposition_mm = 0; 0; 9\naxis = 0; 0; 0\n[camera c]\n",
         "nominal.conf:3: [laser l] axis: 0; 0; 0 has no direction"},
        {"[laser l]\nposition_mm = 0; 0; 0\naxis = 0; 0; 1\n[camera c]\n",
         "nominal.conf:2: [laser l] position_mm: 0; 0; 0 is the middle of the turntable"},
    };
    g_autofree char *dir = session_fixture_new_folder(),
                    *path = g_build_filename(dir, "nominal.conf", NULL);
    for (gsize i = 0; i < G_N_ELEMENTS(bad); i++) {
        g_autoptr(GError) error = NULL;
        g_assert_true(g_file_set_contents(path, bad[i].text, -1, NULL));
        g_assert_null(nominal_read(path, &error));
        g_assert_nonnull(error);
        assert_has(error->message, bad[i].what);
    }
}

/* A camera that looks straight down, or nearly, shows x to the right at turn 0, as a map does, and
 * is aimed at its target all the same. */
TEST(nominal__downward) {
    static const struct {
        const char *eye;
        double turn_deg, right[2];
    } cameras[] = {{"0; 0; 500", 0, {1, 0}},
                   {"0; 0; 500", 90, {0, -1}},
                   {"3; -4; 500", 0, {1, 0}},
                   {"0; -200; 500", 0, {1, 0}},
                   {"-200; 0; 500", 0, {0, -1}}};
    g_autofree char *dir = session_fixture_new_folder(),
                    *path = g_build_filename(dir, "nominal.conf", NULL);
    for (gsize i = 0; i < G_N_ELEMENTS(cameras); i++) {
        g_autoptr(GError) error = NULL;
        g_autofree char *text = g_strdup_printf("[camera c]\nwidth = 9\nheight = 9\nfocal_px = 90\n"
                                                "eye_mm = %s\nturn_deg = %g\n",
                                                cameras[i].eye, cameras[i].turn_deg);
        g_assert_true(g_file_set_contents(path, text, -1, NULL));
        g_autoptr(Calibration) made = nominal_read(path, &error);
        g_assert_no_error(error);
        const struct rig_camera *made_camera = &made->rig.cameras[0];
        const double *right = made_camera->rotation.m[0];
        g_assert_cmpfloat_with_epsilon(right[0], cameras[i].right[0], 0.01);
        g_assert_cmpfloat_with_epsilon(right[1], cameras[i].right[1], 0.01);
        g_assert_cmpint(nominal_looks_down(made_camera), ==, i < 3);
        g_assert_cmpfloat_with_epsilon(made_camera->translation_mm.x, 0, 1e-9); /* of the middle */
        g_assert_cmpfloat_with_epsilon(made_camera->translation_mm.y, 0, 1e-9);
    }
}

/* What the template leaves open is named; filled in, the pictures are imported with it. */
TEST(nominal__template) {
    g_autofree char *dir = session_fixture_new_folder(),
                    *table = g_build_filename(dir, "poses.csv", NULL);
    g_autofree char *path = g_build_filename(dir, "to_fill.conf", NULL), *text = NULL;
    g_autofree char *path_out = session_fixture_path("filled");
    g_autofree float *planes = render(smooth_print, 1);
    write_exr(dir, "a.exr", planes, 3);
    g_assert_true(g_file_set_contents(table, "file,camera,lamp\na.exr,cam,lamp\n", -1, NULL));
    g_free(process_mesorig(0, "import poses %s --template -o %s", table, path));
    g_autofree char *again = process_mesorig(1, "import poses %s --template -o %s", table, path);
    assert_has(again, "exists already");
    g_autofree char *open =
        process_mesorig(1, "import poses %s -c %s -s 36x36 -o %s", table, path, path_out);
    assert_has(open, "focal_px: “?” is not a number");
    g_assert_true(g_file_get_contents(path, &text, NULL, NULL));
    assert_has(text, "width = 96\n");
    g_autoptr(GString) filled = g_string_new(text);
    g_string_replace(filled, "focal_px = ?", "focal_px = 1100", 0);
    g_string_replace(filled, "eye_mm = ?", "eye_mm = 325; 0; 562.9", 0);
    g_string_replace(filled, "position_mm = ?", "position_mm = 321.4; 0; 383", 0);
    g_assert_true(g_file_set_contents(path, filled->str, -1, NULL));
    g_free(process_mesorig(0, "import poses %s -c %s -s 36x36 --reference 4 -o %s", table, path,
                           path_out));
}

/* A photograph of a Canon EOS 5D, whose sensor is 35.8 mm wide with 4368 pixels, reduced to a
 * quarter: a lens of 50 mm is 50 / 35.8 · 1092 = 1525 pixels long. */
TEST(nominal__exif) {
    static const struct told canon = {
        .focal = {50, 1}, .plane = {4368000, 1415}, .plane_unit = 2, .full_px = 4368};
    static const struct told phone = {.focal = {42, 10}, .film_mm = 28};
    static const struct told adapter = {.focal = {0, 1}, .plane = {4368000, 1415}, .plane_unit = 2};
    static const struct told *const told[] = {&canon, &phone, &adapter};
    g_autofree char *dir = session_fixture_new_folder(),
                    *table = g_build_filename(dir, "poses.csv", NULL);
    g_autofree guint8 *rgb = g_new0(guint8, 3 * 1092 * 728);
    for (gsize i = 0; i < G_N_ELEMENTS(told); i++) {
        g_autofree char *name = g_strdup_printf("%d.jpg", (int)i);
        g_autofree char *path = g_build_filename(dir, name, NULL);
        told_jpeg(path, 1092, 728, rgb, told[i]);
    }
    g_assert_true(g_file_set_contents(
        table, "file,camera,lamp\n0.jpg,canon,l\n1.jpg,phone,l\n2.jpg,adapter,l\n", -1, NULL));
    g_autoptr(GError) error = NULL;
    g_autofree char *text = nominal_template(table, &error);
    g_assert_no_error(error);
    double focal_px[2];
    const char *at = text;
    for (int i = 0; i < 2; i++) {
        at = strstr(at, "\nfocal_px = ");
        g_assert_nonnull(at);
        at += strlen("\nfocal_px = ");
        focal_px[i] = g_ascii_strtod(at, NULL);
    }
    g_assert_cmpfloat_with_epsilon(focal_px[0], 1525, 0.005 * 1525);
    /* 28 mm on film of 43.27 mm across */
    g_assert_cmpfloat_with_epsilon(focal_px[1], 28 / 43.27 * hypot(1092, 728), 0.5);
    assert_has(text, "(EXIF: 50 mm, 30.38 pixels per mm)");
    assert_has(text, "(EXIF: as 28 mm on 35 mm film)");
    assert_has(strstr(text, "[camera adapter]"), "\nfocal_px = ?\n");
}

static double check_print(double x_mm, double y_mm, int c) {
    static const double squares[2][3] = {{0.7, 0.25, 0.15}, {0.15, 0.3, 0.6}};
    return squares[(int)(floor((x_mm - 0.5) / 6) + floor((y_mm - 0.5) / 6)) & 1][c];
}

static const struct foreign_sphere ball = {{6, -4, PLANE_MM + 2}, 2, {0.8, 0.8, 0.2}};
static const struct foreign_scene tutorial = {PLANE_MM, check_print, &ball, 1};
static const double tutorial_turns_deg[] = {0, 90, 180};

/* The pictures and the table of docs/build-a-rig/your-own-rig.md. */
static void write_tutorial(const char *dir) {
    const struct coding coding = {NULL, NULL, 12, 16, 256, FALSE, 0.25};
    g_autoptr(GString) rows =
        g_string_new("file,camera,lamp,turntable_deg,exposure_ms,bits,black_level,flat_field\n");
    g_autofree char *table = g_build_filename(dir, "poses.csv", NULL);
    for (gsize t = 0; t < G_N_ELEMENTS(tutorial_turns_deg); t++)
        for (int k = 0; k < LAMPS; k++) {
            const struct foreign_shot shot = {
                &camera, &lamp, azimuths_deg[k] * DEGREE, tutorial_turns_deg[t] * DEGREE, 1, 8};
            g_autofree char *name =
                g_strdup_printf("t%03.0f_l%d.png", tutorial_turns_deg[t], k + 1);
            g_autofree float *planes = foreign_render(&tutorial, &shot);
            write_coded(&coding, dir, name, planes, 0);
            g_string_append_printf(rows, "%s,cam,lamp%d,%g,1,12,256,flat.png\n", name, k + 1,
                                   tutorial_turns_deg[t]);
        }
    write_coded(&coding, dir, "flat.png", NULL, 0.5);
    g_assert_true(g_file_set_contents(table, rows->str, -1, NULL));
}

/* The nominal values that its reader fills in, and what two mistakes in them cost. */
static const struct nominal {
    const char *focal, *eye, *what;
} nominals[] = {{"focal_px = 1100", "eye_mm = 325; 0; 562.9", "as it is"},
                {"focal_px = 1100", "eye_mm = 325; 3; 562.9", "lens 3 mm aside, aimed again"},
                {"focal_px = 1111", "eye_mm = 325; 0; 562.9", "focal length 1 % too long"}};

static char *fill_template(const char *dir, const struct nominal *nominal) {
    static const char *const names[] = {"lamp1", "lamp2", "lamp3", "lamp4"};
    g_autofree char *path = g_build_filename(dir, "nominal.conf", NULL), *text = NULL;
    g_remove(path);
    g_free(process_mesorig(0, "import poses %s/poses.csv --template -o %s", dir, path));
    g_assert_true(g_file_get_contents(path, &text, NULL, NULL));
    g_autoptr(GString) filled = g_string_new(text);
    g_string_replace(filled, "focal_px = ?", nominal->focal, 1);
    g_string_replace(filled, "eye_mm = ?", nominal->eye, 1);
    g_string_replace(filled, "response = 1000", "response = 6000", 1);
    g_string_replace(filled, "intensity = 1\n", "intensity = 400\n", 0);
    for (gsize k = 0; k < LAMPS; k++) {
        const double r = lamp.distance_mm * sin(lamp.theta), a = azimuths_deg[k] * DEGREE;
        g_autofree char *at = g_strdup_printf("position_mm = %.1f; %.1f; %.1f", r * cos(a),
                                              r * sin(a), lamp.distance_mm * cos(lamp.theta));
        g_assert_nonnull(strstr(filled->str, names[k]));
        g_string_replace(filled, "position_mm = ?", at, 1);
    }
    g_assert_null(strchr(strstr(filled->str, "[rig]"), '?'));
    g_assert_true(g_file_set_contents(path, filled->str, -1, NULL));
    return g_steal_pointer(&path);
}

/* Adds squared errors of one picture's texels that show nothing but lit print: against the mean of
 * ρ cos θ over the texel. */
static void add_errors(const struct exr_part *part, const struct foreign_shot *shot, double *sum,
                       int *n) {
    static const char *const names[] = {"R", "G", "B"};
    const double texel_mm = WIDTH_MM / TEXELS;
    for (int texel = 0; texel < TEXELS * TEXELS; texel++) {
        double wanted[3] = {0};
        gboolean clear = TRUE;
        for (int i = 0; i < 64; i++) {
            const int across = i % 8, down = i / 8;
            double x, y;
            middle_of(texel, &x, &y);
            x += ((across + 0.5) / 8 - 0.5) * texel_mm;
            y -= ((down + 0.5) / 8 - 0.5) * texel_mm;
            clear = clear && foreign_clear(&tutorial, shot, x, y);
            for (int c = 0; c < 3; c++)
                wanted[c] +=
                    check_print(x, y, c) * light_cosine(shot->arc - shot->turntable, x, y) / 64;
        }
        for (int c = 0; clear && c < 3; c++)
            *sum += pow((double)exr_part_plane(part, names[c])[texel] - wanted[c], 2);
        *n += clear ? 3 : 0;
    }
}

/* The steps of docs/build-a-rig/your-own-rig.md; returns the RMS error over what shows nothing but
 * lit print. */
static double tutorial_error(const char *dir, const struct nominal *values) {
    g_autofree char *nominal = fill_template(dir, values);
    g_autofree char *name = g_strdup_printf("tutorial%d.session", (int)(values - nominals));
    g_autofree char *path = session_fixture_path(name);
    double sum = 0;
    int n = 0;
    g_free(process_mesorig(0,
                           "import poses %s/poses.csv -c %s --sample 36x36 --texels %d "
                           "--reference 4 --same-light 1 -o %s",
                           dir, nominal, TEXELS, path));
    g_free(process_mesorig(0, "process %s", path));
    for (int view = 0; view < 3; view++) {
        g_autofree char *file = g_strdup_printf("%s/products/btf/view_%04d.exr", path, view);
        g_autoptr(ExrFile) exr = exr_read(file, NULL);
        g_assert_true(exr && exr->parts->len == LAMPS);
        for (int light = 0; light < LAMPS; light++) {
            /* In the first view lamp k is light k; each further one is a quarter of a turn on. */
            const int k = (light + view) % LAMPS;
            const struct foreign_shot shot = {
                &camera, &lamp, azimuths_deg[k] * DEGREE, tutorial_turns_deg[view] * DEGREE, 1, 8};
            add_errors(exr->parts->pdata[light], &shot, &sum, &n);
        }
    }
    g_assert_cmpint(n, >, 3 * TEXELS * TEXELS * 3 * LAMPS * 9 / 10);
    g_test_message("%s: RMS error %.4f over %d values", values->what, sqrt(sum / n), n);
    return sqrt(sum / n);
}

/* The figures in docs/build-a-rig/your-own-rig.md. FOREIGN_RIG=DIR keeps the pictures there
 * instead. */
TEST(tutorial) {
    const char *kept = g_getenv("FOREIGN_RIG");
    g_autofree char *dir = kept ? g_strdup(kept) : session_fixture_new_folder();
    g_mkdir_with_parents(dir, 0777);
    write_tutorial(dir);
    if (kept)
        return;
    const double right = tutorial_error(dir, &nominals[0]);
    g_assert_cmpfloat(right, <, 0.02);
    for (gsize i = 1; i < G_N_ELEMENTS(nominals); i++)
        g_assert_cmpfloat(tutorial_error(dir, &nominals[i]), >, 1.2 * right);
}

BEFORE_TESTS {
    session_fixture_folder = g_dir_make_tmp("mesorig-foreign-XXXXXX", NULL);
    for (gsize i = 0; i < G_N_ELEMENTS(codings); i++) {
        g_autofree char *name = g_strdup_printf("/foreign_rig/coding/%d", (int)i);
        g_test_add_data_func(name, &codings[i], test_coding);
    }
}

AFTER_TESTS {
    remove_tree(session_fixture_folder);
    g_free(session_fixture_folder);
}
