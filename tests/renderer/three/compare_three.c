/* MesorigMaterial in three.js, which npm installs, against the viewer: mean CIEDE2000 of what a
 * torus covers, with silhouettes and shadows, of three materials from six views under six lights.
 */
#include "drawing/gl/gpu.h"
#include "drawing/methods/lpca_revised.h"
#include "formats/compare_pictures.h"
#include "lib/browser.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/relief_scene.h"
#include "lib/remove_tree.h"
#include "lib/view_fixture.h"
#include "lib/view_picture.h"
#include "scene/picture.h"

#define WIDTH    160
#define HEIGHT   120
#define DISTANCE 4.0 /* radii */
#define RADIUS   1.4
#define BOUND    0.5
#define GREY     64
#define THREE    "three@0.170.0"
#define PORT     "8731"

/* azimuth, elevation, theta, phi */
static const int views[6][4] = {{-90, 40, 50, 200}, {-60, 20, 35, 300}, {20, 35, 60, 100},
                                {-120, 25, 45, 10}, {-90, 60, 30, 250}, {45, 15, 70, 330}};

static char *folder;

static char *in_folder(const char *name) {
    return g_build_filename(folder, name, NULL);
}

/* The package with three.js in it. */
static void compare_three_install(void) {
    g_autofree char *package = in_folder("package");
    const char *const copy[] = {"cp", "-r", BUILD_DIR "/three-mesorig", package, NULL};
    const char *const npm[] = {"npm",      "install", "--no-audit", "--no-fund",
                               "--prefix", package,   THREE,        NULL};
    g_assert_cmpint(process_run(copy, NULL, NULL), ==, 0);
    g_assert_cmpint(process_run(npm, NULL, NULL), ==, 0);
}

/* The example's torus as the viewer has it, on pure green. */
static void compare_three_draw(Browser *browser, const int view[4], const char *path) {
    g_autofree char *expression = g_strdup_printf(
        "(({THREE, renderer, scene, camera, torus, material, draw}) => {"
        "const [az, el, theta, phi] = [%d, %d, %d, %d].map(x => x * Math.PI / 180);"
        "scene.background = null; renderer.setClearColor(0x00ff00, 1);"
        "renderer.setPixelRatio(1); renderer.setSize(%d, %d, false);"
        "torus.rotation.set(0, 0, 0); camera.up.set(0, 0, 1); camera.aspect = %d / %d;"
        "camera.position.set(Math.cos(el) * Math.cos(az), Math.cos(el) * Math.sin(az), "
        "Math.sin(el))"
        ".multiplyScalar(%g); camera.lookAt(0, 0, 0); camera.updateProjectionMatrix();"
        "material.settings.light.set(Math.sin(theta) * Math.cos(phi),"
        " Math.sin(theta) * Math.sin(phi), Math.cos(theta));"
        "draw(); return renderer.domElement.toDataURL(); })(example)",
        view[0], view[1], view[2], view[3], WIDTH, HEIGHT, WIDTH, HEIGHT, DISTANCE * RADIUS);
    g_autofree char *url = browser_value(browser, expression);
    gsize size;
    g_assert_true(g_str_has_prefix(url, "data:image/png;base64,"));
    g_autofree guchar *png = g_base64_decode(strchr(url, ',') + 1, &size);
    g_assert_true(g_file_set_contents(path, (const char *)png, (gssize)size, NULL));
}

static guint8 *compare_three_view(Viewer *viewer, const int view[4]) {
    struct viewer_settings s = viewer_settings_default;
    s.camera_azimuth_deg = view[0];
    s.camera_elevation_deg = view[1];
    s.light_theta_deg = view[2];
    s.light_phi_deg = view[3];
    s.camera_distance = DISTANCE;
    s.silhouettes = s.shadows = TRUE;
    guint8 *rgb = ok(view_picture(viewer, &s, WIDTH, HEIGHT, ERR));
    return rgb;
}

/* Compares the pixels that three.js has drawn; returns the mean over these. */
static double compare_three_pixels(const char *path, guint8 *is) {
    g_autofree char *a = in_folder("a.png"), *b = in_folder("b.png");
    g_autoptr(GError) error = NULL;
    struct picture_comparison found;
    int width, height, n = 0;
    g_autofree guint8 *page = view_fixture_read_png(path, &width, &height);
    g_assert_cmpint(width, ==, WIDTH);
    for (gsize k = 0; k < 3 * (gsize)WIDTH * HEIGHT; k += 3) {
        const gboolean drawn = page[k] != 0 || page[k + 1] != 255 || page[k + 2] != 0;
        n += drawn;
        for (gsize c = 0; !drawn && c < 3; c++)
            page[k + c] = is[k + c] = GREY;
    }
    g_assert_cmpint(n, >, WIDTH * HEIGHT / 8);
    picture_write_png(a, page, WIDTH, HEIGHT, NULL, &error);
    picture_write_png(b, is, WIDTH, HEIGHT, NULL, &error);
    ok(compare_pictures(a, b, &found, ERR));
    return found.delta_e * WIDTH * HEIGHT / n;
}

static double compare_three_material(Viewer *viewer, enum relief_kind kind) {
    g_autofree char *material = in_folder("material.exr"), *mdf = in_folder("mdf.exr");
    g_autofree char *file = in_folder("package/material.mesoweb"), *page = in_folder("page.png");
    double worst = 0;
    relief_scene_write(kind, material, mdf);
    g_unlink(file);
    g_free(process_mesorig(0, "export web %s -o %s", material, file));
    ok(viewer_open(viewer, &method_lpca_revised, material, ERR));
    ok(viewer_open_mdf(viewer, mdf, ERR));
    Browser *browser = browser_new(640, 480);
    browser_open(browser, "http://127.0.0.1:" PORT "/example.html");
    browser_wait(browser, "window.example !== undefined");
    for (gsize k = 0; k < G_N_ELEMENTS(views); k++) {
        compare_three_draw(browser, views[k], page);
        g_autofree guint8 *is = compare_three_view(viewer, views[k]);
        const double delta_e = compare_three_pixels(page, is);
        g_print("material %d, view %zu: mean CIEDE2000 %.3f\n", kind, k, delta_e);
        worst = MAX(worst, delta_e);
    }
    browser_free(browser);
    return worst;
}

int main(void) {
    g_autoptr(GError) error = NULL;
    double worst = 0;
    folder = g_dir_make_tmp("mesorig-three-XXXXXX", NULL);
    g_autofree char *package = in_folder("package");
    compare_three_install();
    GSubprocess *server =
        process_start(G_SUBPROCESS_FLAGS_STDOUT_SILENCE | G_SUBPROCESS_FLAGS_STDERR_SILENCE, NULL,
                      (const char *[]){"python3", "-m", "http.server", PORT, "--bind", "127.0.0.1",
                                       "--directory", package, NULL});
    g_autoptr(Gpu) gpu = gpu_new_headless(&error);
    g_assert_no_error(error);
    g_autoptr(Viewer) viewer = viewer_new(NULL, &error);
    g_assert_no_error(error);
    g_autoptr(Mesh) mesh = scene_make("torus", &(struct scene_options){0}, &error);
    ok(viewer_set_mesh(viewer, mesh, ERR));
    for (int kind = 0; kind < RELIEF_KINDS; kind++)
        worst = MAX(worst, compare_three_material(viewer, (enum relief_kind)kind));
    g_subprocess_force_exit(server);
    g_object_unref(server);
    remove_tree(folder);
    g_free(folder);
    g_print("worst of all: %.3f, at most %.1f is asked\n", worst, BOUND);
    return worst > BOUND;
}
