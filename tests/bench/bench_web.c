/* The page of mesorig export web next to the viewer: mean CIEDE2000 over the pixels that show the
 * shape, of the same local PCA and MDF, with silhouettes and shadows. For several views, lamps and
 * shapes. */
#include "bench.h"
#include "drawing/gl/gpu.h"
#include "drawing/methods/lpca_revised.h"
#include "formats/compare_pictures.h"
#include "lib/browser.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/view_fixture.h"
#include "lib/view_picture.h"
#include "scene/picture.h"

#define WIDTH      320
#define HEIGHT     240
#define SAMPLES    2
#define SHADOW_MAP 512
#define LIMIT      0.5
#define BACKGROUND 3 /* rows and columns at the corner that show none of the shape */

static const struct bench_web_view {
    const char *shape;
    int azimuth_deg, elevation_deg, theta_deg, phi_deg;
} views[] = {{"torus", -90, 40, 50, 200},   {"sphere", -60, 20, 35, 300},
             {"plane", 20, 35, 60, 100},    {"cylinder", -120, 25, 45, 10},
             {"cylinder", 60, 60, 30, 250}, {"torus", 45, 15, 70, 330}};

static void page_picture(Browser *browser, const struct bench_web_view *v, const char *path) {
    g_autoptr(GError) error = NULL;
    gsize size;
    g_autofree char *expression = g_strdup_printf(
        "mesorig.pictureUrl({shape: '%s', cameraAzimuthDeg: %d, cameraElevationDeg: %d, "
        "lightThetaDeg: %d, lightPhiDeg: %d, supersample: %d, shadowMap: %d}, %d, %d)",
        v->shape, v->azimuth_deg, v->elevation_deg, v->theta_deg, v->phi_deg, SAMPLES, SHADOW_MAP,
        WIDTH, HEIGHT);
    g_autofree char *url = browser_value(browser, expression);
    if (!g_str_has_prefix(url, "data:image/png;base64,"))
        bench_fail(1, "the page gives no picture");
    g_autofree guchar *png = g_base64_decode(strchr(url, ',') + 1, &size);
    g_file_set_contents(path, (const char *)png, (gssize)size, &error);
    bench_check(error);
}

static guint8 *viewer_picture(Viewer *viewer, const struct bench_web_view *v) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Mesh) mesh = scene_make(v->shape, &(struct scene_options){0}, &error);
    bench_check(error);
    struct viewer_settings s = viewer_settings_default;
    viewer_set_mesh(viewer, mesh, &error);
    bench_check(error);
    s.camera_azimuth_deg = v->azimuth_deg;
    s.camera_elevation_deg = v->elevation_deg;
    s.light_theta_deg = v->theta_deg;
    s.light_phi_deg = v->phi_deg;
    s.samples = SAMPLES;
    s.silhouettes = s.shadows = TRUE;
    s.shadow_size = SHADOW_MAP;
    guint8 *rgb = view_picture(viewer, &s, WIDTH, HEIGHT, &error);
    bench_check(error);
    return rgb;
}

/* The mean over pixels of which at least one picture shows something else than its corner. */
static double shape_difference(const char *folder, const char *page, const guint8 *is) {
    g_autoptr(GError) error = NULL;
    g_autofree char *path = g_build_filename(folder, "view.png", NULL);
    struct picture_comparison found;
    int width, height, n = 0;
    g_autofree guint8 *of_page = view_fixture_read_png(page, &width, &height);
    if (width != WIDTH || height != HEIGHT)
        bench_fail(1, "the page's picture has %d × %d pixels", width, height);
    const gsize corner = 3 * (gsize)(BACKGROUND * WIDTH + BACKGROUND);
    for (gsize k = 0; k < 3 * (gsize)WIDTH * HEIGHT; k += 3)
        n += memcmp(of_page + k, of_page + corner, 3) != 0 || memcmp(is + k, is + corner, 3) != 0;
    picture_write_png(path, is, WIDTH, HEIGHT, NULL, &error);
    bench_check(error);
    compare_pictures(page, path, &found, &error);
    bench_check(error);
    /* Elsewhere both must show their backgrounds only, which have to be the same. */
    if (n < WIDTH * HEIGHT / 8 || memcmp(of_page + corner, is + corner, 3) != 0)
        bench_fail(1, "shape not seen, or backgrounds differ");
    return found.delta_e * WIDTH * HEIGHT / n;
}

static double bench_web_material(const char *folder, const char *material) {
    g_autoptr(GError) error = NULL;
    g_autofree char *page = g_build_filename(folder, "page.html", NULL);
    g_autofree char *png = g_build_filename(folder, "page.png", NULL);
    g_autofree char *address = g_strconcat("file://", page, NULL);
    g_autofree char *beside = g_path_get_dirname(material);
    g_autofree char *mdf = g_build_filename(beside, "mdf.exr", NULL);
    const char *const export[] = {
        BUILD_DIR "/bin/mesorig", "export", "web", material, "-o", page, "--force", NULL};
    if (process_run(export, NULL, NULL) != 0)
        bench_fail(1, "%s: mesorig export web fails", material);
    g_autoptr(Viewer) viewer = viewer_new(NULL, &error);
    bench_check(error);
    viewer_open(viewer, &method_lpca_revised, material, &error);
    bench_check(error);
    viewer_open_mdf(viewer, mdf, &error);
    bench_check(error);
    Browser *browser = browser_new(640, 480);
    browser_open(browser, address);
    browser_wait(browser, "window.mesorig !== undefined");
    double sum = 0, worst = 0;
    bench_begin(NULL);
    bench_put("%s{material}", material);
    bench_begin_list("views");
    for (gsize k = 0; k < G_N_ELEMENTS(views); k++) {
        page_picture(browser, &views[k], png);
        g_autofree guint8 *is = viewer_picture(viewer, &views[k]);
        const double delta_e = shape_difference(folder, png, is);
        bench_row(NULL, "%s{shape} %.4f{delta_e}", views[k].shape, delta_e);
        sum += delta_e;
        worst = MAX(worst, delta_e);
    }
    bench_end();
    bench_put("%.4f{mean} %.4f{worst}", sum / G_N_ELEMENTS(views), worst);
    bench_end();
    browser_free(browser);
    return worst;
}

int main(int argc, char **argv) {
    bench_parse(&argc, &argv, NULL, "LPCA.exr…");
    if (argc < 2)
        bench_fail(2, "name files of local PCA that have an mdf.exr beside them");
    g_autofree char *folder = g_dir_make_tmp("mesorig-XXXXXX", NULL);
    g_autoptr(GError) error = NULL;
    g_autoptr(Gpu) gpu = gpu_new_headless(&error);
    bench_check(error);
    double worst = 0;
    bench_begin(NULL);
    bench_begin_list("materials");
    for (int k = 1; k < argc; k++)
        worst = MAX(worst, bench_web_material(folder, argv[k]));
    bench_end();
    bench_put("%.4f{worst} %.1f{limit}", worst, LIMIT);
    bench_end();
    remove_tree(folder);
    return worst > LIMIT;
}
