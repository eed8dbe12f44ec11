/* The page of a material in a browser, against the viewer's pictures of the same file; its size;
 * what cannot be exported. */
#include "codecs/lpca/lpca_levels.h"
#include "drawing/gl/gpu.h"
#include "drawing/methods/lpca_revised.h"
#include "drawing/methods/neural_view.h"
#include "exr/exr_half.h"
#include "formats/compare_pictures.h"
#include "lib/browser.h"
#include "lib/neural_fixture.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/relief_scene.h"
#include "lib/remove_tree.h"
#include "lib/skip.h"
#include "lib/test.h"
#include "lib/view_fixture.h"
#include "lib/view_picture.h"
#include "scene/picture.h"
#include "scene/viewer.h"
#include "shapes/scene.h"

#include <glib/gstdio.h>
#include <json-glib/json-glib.h>
#include <math.h>
#include <string.h>

#define WIDTH      120
#define HEIGHT     90
#define SAMPLES    2
#define SHADOW_MAP 256
#define BOUND      0.25 /* mean CIEDE2000 */
#define MB         1000000
#define SIDE       128 /* of the material whose size is asked */
#define CLUSTERS   32
#define PARTS      8

/* The page also draws its own picture, in the size of the window. */
#define PAGE_WIDTH  320
#define PAGE_HEIGHT 240

static char *folder;
static Browser *browser_of_all;

static const char *in_folder(const char *name) {
    static char path[256];
    g_snprintf(path, sizeof path, "%s/%s", folder, name);
    return path;
}

/* Tests use the same browser, because it takes seconds of processor time to start. test_pictures()
 * starts its own: in a browser that had shown another material at the same address, a picture
 * differed by more than BOUND. */
static Browser *the_browser(void) {
    if (!browser_of_all)
        browser_of_all = browser_new(PAGE_WIDTH, PAGE_HEIGHT);
    return browser_of_all;
}

static const struct view {
    const char *shape;
    int azimuth_deg, elevation_deg, theta_deg, phi_deg;
} views[] = {{"torus", -90, 40, 50, 200},   {"sphere", -60, 20, 35, 300},
             {"plane", 20, 35, 60, 100},    {"cylinder", -120, 25, 45, 10},
             {"cylinder", 60, 60, 30, 250}, {"torus", 45, 15, 70, 330}};

/* Its parts lie behind each other more often than any other's, and it takes longest: of one
 * material. */
static const struct view knot = {"torus-knot", -90, 50, 30, 250};

/* Drawn with views along the surface. */
static const struct view along_views[] = {{"torus", -90, 40, 50, 200},
                                          {"cylinder", 60, 60, 30, 250}};

/* The picture of mesorig.pictureUrl(…) as page.png. */
static void webgl_test_save(Browser *browser, const char *expression) {
    g_autofree char *url = browser_value(browser, expression);
    gsize size;
    g_assert_true(g_str_has_prefix(url, "data:image/png;base64,"));
    g_autofree guchar *png = g_base64_decode(strchr(url, ',') + 1, &size);
    g_assert_true(
        g_file_set_contents(in_folder("page.png"), (const char *)png, (gssize)size, NULL));
}

static void webgl_test_draw_page(Browser *browser, const struct view *v, gboolean along) {
    g_autofree char *expression = g_strdup_printf(
        "mesorig.pictureUrl({shape: '%s', cameraAzimuthDeg: %d, cameraElevationDeg: %d, "
        "lightThetaDeg: %d, lightPhiDeg: %d, supersample: %d, shadowMap: %d, alongSurface: %s}, "
        "%d, "
        "%d)",
        v->shape, v->azimuth_deg, v->elevation_deg, v->theta_deg, v->phi_deg, SAMPLES, SHADOW_MAP,
        along ? "true" : "false", WIDTH, HEIGHT);
    webgl_test_save(browser, expression);
}

/* The viewer with the material's file and the MDF's, as mesorig-view --method has it. */
static Viewer *webgl_test_viewer(const struct method *method) {
    Viewer *viewer = ok(viewer_new(NULL, ERR));
    ok(viewer_open(viewer, method, in_folder("material.exr"), ERR));
    ok(viewer_open_mdf(viewer, in_folder("mdf.exr"), ERR));
    return viewer;
}

static void webgl_test_draw_view(Viewer *viewer, const struct view *v, gboolean along) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Mesh) mesh = scene_make(v->shape, &(struct scene_options){0}, &error);
    struct viewer_settings settings = viewer_settings_default;
    g_assert_no_error(error);
    ok(viewer_set_mesh(viewer, mesh, ERR));
    settings.camera_azimuth_deg = v->azimuth_deg;
    settings.camera_elevation_deg = v->elevation_deg;
    settings.light_theta_deg = v->theta_deg;
    settings.light_phi_deg = v->phi_deg;
    settings.samples = SAMPLES;
    settings.silhouettes = settings.shadows = TRUE;
    settings.along_surface = along;
    settings.shadow_size = SHADOW_MAP;
    g_autofree guint8 *rgb = ok(view_picture(viewer, &settings, WIDTH, HEIGHT, ERR));
    ok(picture_write_png(in_folder("view.png"), rgb, WIDTH, HEIGHT, NULL, ERR));
}

/* Drawn with silhouettes and shadows by both. A page that ignored either would be far off: without
 * shadows only, the first picture differs by more than the bound. */
static void webgl_test_compare(Browser *browser, Viewer *viewer, enum relief_kind kind) {
    g_autofree char *page = g_strdup(in_folder("page.png"));
    struct picture_comparison found;
    for (gsize k = 0; k < G_N_ELEMENTS(views) + (kind == RELIEF_GROOVES); k++) {
        const struct view *view = k < G_N_ELEMENTS(views) ? &views[k] : &knot;
        webgl_test_draw_page(browser, view, FALSE);
        webgl_test_draw_view(viewer, view, FALSE);
        ok(compare_pictures(page, in_folder("view.png"), &found, ERR));
        g_test_message("material %d on the %s: mean CIEDE2000 %.3f, of differing pixels %.3f", kind,
                       view->shape, found.delta_e, found.delta_e_different);
        g_assert_cmpfloat(found.delta_e, <=, BOUND);
    }
}

/* The same with views along the surface. A page that ignored this option would be further off than
 * the bound. */
static void compare_along(Browser *browser, Viewer *viewer, enum relief_kind kind) {
    g_autofree char *page = g_strdup(in_folder("page.png"));
    struct picture_comparison found, without;
    for (gsize k = 0; k < G_N_ELEMENTS(along_views); k++) {
        const struct view *view = &along_views[k];
        webgl_test_draw_page(browser, view, TRUE);
        webgl_test_draw_view(viewer, view, FALSE);
        ok(compare_pictures(page, in_folder("view.png"), &without, ERR));
        webgl_test_draw_view(viewer, view, TRUE);
        ok(compare_pictures(page, in_folder("view.png"), &found, ERR));
        g_test_message("material %d on the %s along the surface: mean CIEDE2000 %.3f, from the "
                       "picture without this option %.3f",
                       kind, view->shape, found.delta_e, without.delta_e);
        g_assert_cmpfloat(found.delta_e, <=, BOUND);
        g_assert_cmpfloat(without.delta_e, >, 1.5 * BOUND);
    }
}

static void test_pictures(gconstpointer data) {
    const enum relief_kind kind = (enum relief_kind)GPOINTER_TO_INT(data);
    g_autofree char *output = g_strdup(in_folder("page.html"));
    g_autofree char *address = g_strconcat("file://", output, NULL);
    g_autofree char *mdf = g_strdup(in_folder("mdf.exr"));
    relief_scene_write(kind, in_folder("material.exr"), mdf);
    g_unlink(output);
    g_free(process_mesorig(0, "export web %s -o %s", in_folder("material.exr"), output));
    Browser *browser = browser_new(PAGE_WIDTH, PAGE_HEIGHT);
    browser_open(browser, address);
    browser_wait(browser, "window.mesorig !== undefined || document.querySelector('[role=alert]')");
    g_autofree char *said = browser_value(browser, "document.getElementById('step').innerText");
    g_autofree char *ready = browser_value(browser, "typeof window.mesorig");
    if (strcmp(ready, "object") != 0)
        g_error("the page shows: %s", said);
    g_autoptr(Gpu) gpu = gpu_new_headless(NULL);
    if (gpu) {
        g_autoptr(Viewer) viewer = webgl_test_viewer(&method_lpca_revised);
        webgl_test_compare(browser, viewer, kind);
        compare_along(browser, viewer, kind);
    } else {
        test_skip_or_fail("there is no OpenGL 3.3 here");
    }
    g_autofree char *facts = browser_value(browser, "document.getElementById('facts').innerText");
    g_assert_cmpstr(facts, ==, "32 × 32 texels, 8.0 × 8.0 mm");
    g_autofree char *offered =
        browser_value(browser, "document.getElementById('silhouettes').checked");
    g_assert_cmpstr(offered, ==, "true");
    g_autofree char *along = browser_value(
        browser,
        "(() => { const box = document.getElementById('alongSurface'); const before = "
        "[box.disabled, box.checked, mesorig.settings().alongSurface]; box.click(); return "
        "String([...before, box.checked, mesorig.settings().alongSurface]); })()");
    g_assert_cmpstr(along, ==, "false,false,false,true,true");
    browser_free(browser);
}

/* Exports neural planes and opens their page. */
static Browser *open_neural(void) {
    g_autofree char *material = g_strdup(in_folder("material.exr"));
    g_autofree char *output = g_strdup(in_folder("neural.html"));
    g_autofree char *address = g_strconcat("file://", output, NULL);
    struct neural *neural = neural_fixture_new(16, 16, 8, 0.8, 3); /* 8 mm, as the bumps */
    relief_scene_write(RELIEF_BUMPS, material, in_folder("mdf.exr"));
    ok(neural_write(material, &neural, 1, ERR));
    neural_free(neural);
    g_unlink(output);
    g_autofree char *told = process_mesorig(0, "export web %s -o %s --json", material, output);
    assert_has(told, "\"channels\": 8");
    Browser *browser = the_browser();
    browser_open(browser, address);
    browser_wait(browser, "window.mesorig !== undefined || document.querySelector('[role=alert]')");
    g_autofree char *said = browser_value(browser, "document.getElementById('step').innerText");
    g_autofree char *ready = browser_value(browser, "typeof window.mesorig");
    if (strcmp(ready, "object") != 0)
        g_error("the page shows: %s", said);
    return browser;
}

/* Neural planes with relief in a page and in the viewer. A page without their light, rays or
 * network would be far off, because all numbers are random. */
TEST(neural) {
    g_autoptr(Gpu) gpu = gpu_new_headless(NULL);
    if (!gpu) {
        test_skip_or_fail("there is no OpenGL 3.3 here");
        return;
    }
    Browser *browser = open_neural();
    g_autoptr(Viewer) viewer = webgl_test_viewer(&method_neural);
    webgl_test_compare(browser, viewer, RELIEF_BUMPS);
    g_assert_cmpint(g_unlink(in_folder("mdf.exr")), ==, 0); /* other tests have none */
}

/* What does not compress: a local PCA of random numbers, of the size that the page is promised for.
 */
static void webgl_test_write_noise(const char *path) {
    g_autoptr(BtfMatrix) few = btf_fixture_of("noise", PARTS, PARTS, btf_fixture_rings(4, 75, 0),
                                              btf_fixture_rings(4, 75, 5));
    GRand *random = g_rand_new_with_seed(1);
    const gsize n = btf_layout_texels(&few->layout) * btf_layout_values(&few->layout);
    for (gsize k = 0; k < n; k++)
        few->values[k] = (float)g_rand_double(random);
    g_autoptr(Lpca) lpca = relief_scene_compress(few, CLUSTERS, 8);
    const gsize components = (gsize)lpca->n_components;
    int *clusters = g_new(int, SIDE *SIDE);
    float *weights = g_new(float, SIDE *SIDE *components);
    for (gsize k = 0; k < SIDE * SIDE; k++) {
        clusters[k] = g_rand_int_range(random, 0, lpca->n_clusters);
        for (gsize i = 0; i < components; i++)
            weights[components * k + i] = (float)g_rand_double_range(random, -1, 1);
    }
    g_free(lpca->clusters);
    g_free(lpca->weights);
    lpca->clusters = clusters;
    lpca->weights = weights;
    lpca->layout.width = lpca->layout.height = SIDE;
    lpca_quantise(lpca, LPCA_HALF);
    ok(lpca_write_levels(path, (struct lpca *const[]){lpca}, 1, ERR));
    g_rand_free(random);
}

static gint64 webgl_test_size(const char *path) {
    GStatBuf status;
    g_assert_cmpint(g_stat(path, &status), ==, 0);
    return status.st_size;
}

TEST(size) {
    g_autofree char *material = g_strdup(in_folder("noise.exr"));
    g_autofree char *page = g_strdup(in_folder("noise.html"));
    g_autofree char *file = g_strdup(in_folder("noise.mesoweb"));
    webgl_test_write_noise(material);
    g_free(process_mesorig(0, "export web %s -o %s", material, page));
    g_assert_cmpint(webgl_test_size(page), <=, 20 * MB);
    g_free(process_mesorig(0, "export web %s -o %s --size=4MB", material, file));
    g_assert_cmpint(webgl_test_size(file), <=, 4 * MB);
    g_autofree char *few =
        process_mesorig(1, "export web %s -o %s --size=100kB", material, in_folder("few.html"));
    assert_has(few, "give a larger --size");
    g_assert_false(g_file_test(in_folder("few.html"), G_FILE_TEST_EXISTS));
}

/* The file by the description in its header only: JSON by JSON-GLib, sections by zlib. */
TEST(file) {
    g_autofree char *material = g_strdup(in_folder("small.exr")), *text = NULL;
    g_autofree char *file = g_strdup(in_folder("small.mesoweb"));
    g_autoptr(BtfMatrix) btf =
        btf_fixture_of("small", 4, 3, btf_fixture_rings(2, 60, 0), btf_fixture_rings(2, 60, 0));
    g_autoptr(GError) error = NULL;
    g_autoptr(JsonParser) parser = json_parser_new();
    gsize length, total = 0;
    for (gsize k = 0; k < 12 * btf_layout_values(&btf->layout); k++)
        btf->values[k] = 0.5F;
    g_autoptr(Lpca) lpca = relief_scene_compress(btf, 2, 2);
    ok(lpca_write_levels(material, (struct lpca *const[]){lpca}, 1, ERR));
    g_free(process_mesorig(0, "export web %s -o %s", material, file));
    g_assert_true(g_file_get_contents(file, &text, &length, NULL));
    g_assert_cmpmem(text, 8, "mesoweb2", 8);
    guint32 header;
    memcpy(&header, text + 8, sizeof header);
    header = GUINT32_FROM_LE(header);
    ok(json_parser_load_from_data(parser, text + 12, header, ERR));
    JsonObject *root = json_node_get_object(json_parser_get_root(parser));
    JsonArray *sections = json_object_get_array_member(root, "sections");
    const gint64 n = json_object_get_int_member(root, "grid");
    const gint64 clusters = json_object_get_int_member(root, "clusters");
    gsize at = 12 + header;
    for (guint k = 0; k < json_array_get_length(sections); k++) {
        JsonObject *section = json_array_get_object_element(sections, k);
        const gsize bytes = (gsize)json_object_get_int_member(section, "bytes");
        const gsize size = (gsize)json_object_get_int_member(section, "size");
        g_autoptr(GZlibDecompressor) inflate =
            g_zlib_decompressor_new(G_ZLIB_COMPRESSOR_FORMAT_ZLIB);
        g_autofree guint8 *data = g_malloc(size + 1);
        gsize took, gave;
        g_assert_cmpint(g_converter_convert(G_CONVERTER(inflate), text + at, bytes, data, size + 1,
                                            G_CONVERTER_INPUT_AT_END, &took, &gave, &error),
                        ==, G_CONVERTER_FINISHED);
        g_assert_cmpuint(took, ==, bytes);
        g_assert_cmpuint(gave, ==, size);
        if (g_str_equal(json_object_get_string_member(section, "name"), "means")) {
            g_assert_cmpint((gint64)size, ==, 6 * clusters * n * n * (n * n + 1));
            /* Of a light near the zenith, from the first view. */
            const gsize middle = (gsize)(6 * n * n * (n / 2 * n + n / 2));
            float value;
            exr_half_to_floats(&value, (const guint16 *)(gpointer)(data + middle), 1);
            g_assert_cmpfloat_with_epsilon(value, 0.5, 1e-3);
        }
        at += bytes;
        total++;
    }
    g_assert_cmpuint(at, ==, length);
    g_assert_cmpuint(total, ==, 5);
}

/* Constant reflectance as a file; rings: of views, 0 for one only. */
static void webgl_test_write_constant(const char *path, int rings, enum lpca_colours colours) {
    g_autoptr(GError) error = NULL;
    g_autoptr(BtfMatrix) btf = btf_fixture_of("constant", 4, 3, btf_fixture_rings(rings, 60, 0),
                                              btf_fixture_rings(2, 60, 0));
    for (gsize k = 0; k < 12 * btf_layout_values(&btf->layout); k++)
        btf->values[k] = 0.25F;
    const struct lpca_options options = {.n_clusters = 2, .n_components = 2, .colours = colours};
    g_autoptr(Lpca) lpca = lpca_compute(btf, &options, &error);
    g_assert_no_error(error);
    ok(lpca_write_levels(path, (struct lpca *const[]){lpca}, 1, ERR));
}

/* Logarithms are decoded and compressed again; one view is seen from everywhere. */
TEST(converted) {
    g_autofree char *log = g_strdup(in_folder("log.exr")), *one = g_strdup(in_folder("one.exr"));
    webgl_test_write_constant(log, 2, LPCA_LOG);
    webgl_test_write_constant(one, 0, LPCA_RGB);
    g_autofree char *said =
        process_mesorig(0, "export web %s -o %s --json", log, in_folder("log.html"));
    assert_has(said, "\"compressed\": true");
    g_autofree char *of_one =
        process_mesorig(0, "export web %s -o %s --json", one, in_folder("one.html"));
    assert_has(of_one, "\"compressed\": false");
}

/* Linear brightness of the middle of a plane that is seen from above, under this light only. */
static double webgl_test_plane(Browser *browser, double theta_deg, int phi_deg) {
    char theta[G_ASCII_DTOSTR_BUF_SIZE];
    g_autofree char *expression = g_strdup_printf(
        "mesorig.pictureUrl({shape: 'plane', cameraElevationDeg: 90, cameraAzimuthDeg: 0, "
        "lightThetaDeg: %s, lightPhiDeg: %d, ambient: 0, shadows: false, silhouettes: false}, 9, "
        "9)",
        g_ascii_dtostr(theta, sizeof theta, theta_deg), phi_deg);
    webgl_test_save(browser, expression);
    int width, height;
    g_autofree guint8 *rgb = view_fixture_read_png(in_folder("page.png"), &width, &height);
    return pow(rgb[3 * (width * (height / 2) + width / 2)] / 255.0, 2.2);
}

/* Light ends at the horizon by degrees, from whatever azimuth; here of few lights, on a coarse
 * grid, whose corners are at odd multiples of 45°. */
TEST(terminator) {
    g_autofree char *few = g_strdup(in_folder("few.exr")), *page = g_strdup(in_folder("few.html"));
    g_autofree char *address = g_strconcat("file://", page, NULL);
    g_autoptr(BtfMatrix) btf =
        btf_fixture_of("few", 8, 8, btf_fixture_rings(1, 45, 0), btf_fixture_rings(1, 45, 45));
    const gsize n_lights = btf->layout.lights.n;
    for (gsize k = 0; k < 64 * btf_layout_values(&btf->layout); k++)
        btf->values[k] =
            0.5F * cosf(btf->layout.lights.theta_deg[k / 3 % n_lights] * (float)G_PI / 180);
    g_autoptr(Lpca) lpca = relief_scene_compress(btf, 2, 2);
    ok(lpca_write_levels(few, (struct lpca *const[]){lpca}, 1, ERR));
    g_free(process_mesorig(0, "export web %s -o %s", few, page));
    Browser *browser = the_browser();
    browser_open(browser, address);
    browser_wait(browser, "window.mesorig !== undefined");
    for (int phi_deg = 0; phi_deg < 360; phi_deg += 45) {
        const double high = webgl_test_plane(browser, 60, phi_deg),
                     low = webgl_test_plane(browser, 89.8, phi_deg);
        g_test_message("azimuth %d: %.4f at 60°, %.4f at 89.8°", phi_deg, high, low);
        g_assert_cmpfloat(high, >, 0.05);
        g_assert_cmpfloat(low, <, high / 50);
    }
}

/* A session's directory: its BTF is compressed, its products/lpca.exr is taken as it is. */
TEST(session) {
    g_autofree char *btf = g_strdup(in_folder("session.btf"));
    g_autofree char *session = g_strdup(in_folder("small.session"));
    g_autofree char *values = g_strdup(in_folder("session.values"));
    const char *argv[] = {"python3", SOURCE_DIR "/tests/bonn_peer.py", "write", "bdi", btf, values,
                          NULL};
    g_free(process_text(0, argv));
    g_free(process_mesorig(0, "import btf %s -o %s", btf, session));
    g_autofree char *whole =
        process_mesorig(0, "export web %s -o %s --json", session, in_folder("whole.html"));
    assert_has(whole, "\"compressed\": true");
    g_autofree char *page = NULL;
    g_assert_true(g_file_get_contents(in_folder("whole.html"), &page, NULL, NULL));
    assert_has(page, "</html>");
    g_free(process_mesorig(0, "compress %s --clusters 2 --components 3", session));
    g_autofree char *by_session = g_strdup(in_folder("session.mesoweb"));
    g_autofree char *by_file = g_strdup(in_folder("file.mesoweb"));
    g_autofree char *taken = process_mesorig(0, "export web %s -o %s --json", session, by_session);
    assert_has(taken, "\"compressed\": false");
    assert_has(taken, "\"clusters\": 2, \"components\": 3");
    g_free(process_mesorig(0, "export web %s/products/lpca.exr -o %s", session, by_file));
    g_autofree char *one = NULL, *other = NULL;
    gsize bytes = 0, other_bytes = 0;
    g_assert_true(g_file_get_contents(by_session, &one, &bytes, NULL));
    g_assert_true(g_file_get_contents(by_file, &other, &other_bytes, NULL));
    g_assert_cmpmem(one, bytes, other, other_bytes);
}

static void webgl_test_refused(const char *command, const char *words) {
    g_autofree char *said = process_mesorig(1, "%s", command);
    assert_has(said, words);
}

TEST(refused) {
    g_autofree char *there = g_strdup(in_folder("there.html")), *nowhere = NULL, *content = NULL;
    g_autofree char *to = g_strdup(in_folder("refused.html"));
    g_assert_true(g_file_set_contents(there, "mine", -1, NULL));
    g_autofree char *exists = g_strdup_printf("export web %s -o %s", in_folder("small.exr"), there);
    webgl_test_refused(exists, "exists already");
    g_assert_true(g_file_get_contents(there, &content, NULL, NULL));
    g_assert_cmpstr(content, ==, "mine");
    nowhere = g_strdup_printf("export web %s -o %s/none/page.html", in_folder("small.exr"), folder);
    webgl_test_refused(nowhere, "make it first");
    g_autofree char *no_session = g_strdup_printf("export web %s -o %s", folder, to);
    webgl_test_refused(no_session, folder);
    g_autofree char *no_output = g_strdup_printf("export web %s", folder);
    webgl_test_refused(no_output, "no file to write is given");
    g_autofree char *ending = g_strdup_printf("export web %s -o %s/page.png", folder, folder);
    webgl_test_refused(ending, "give a name that ends in .html");
    g_autofree char *no_mdf = g_strdup_printf("export web %s -o %s --mdf=%s/none.exr",
                                              in_folder("small.exr"), to, folder);
    webgl_test_refused(no_mdf, "none.exr");
    g_autofree char *other = g_strdup(in_folder("other.exr"));
    g_autofree char *bumps = g_strdup(in_folder("bumps.exr"));
    relief_scene_write(RELIEF_BUMPS, other, bumps);
    g_autofree char *other_mdf =
        g_strdup_printf("export web %s -o %s --mdf=%s", in_folder("small.exr"), to, bumps);
    webgl_test_refused(other_mdf, "give the MDF of the same session");
    g_free(process_mesorig(2, "export web %s -o %s --size=many", folder, to));
    g_assert_false(g_file_test(to, G_FILE_TEST_EXISTS));
}

static void check_incomplete(Browser *browser, const char *address) {
    browser_open(browser, address);
    browser_wait(browser, "document.querySelector('[role=alert]') !== null");
    g_autofree char *said = browser_value(browser, "document.getElementById('step').innerText");
    g_assert_cmpstr(said, ==, "The page is incomplete; copy or download it again.");
}

/* A page that was cut off says so; small.exr is test_file()'s. */
TEST(cut) {
    g_autofree char *page = g_strdup(in_folder("small.html")),
                    *cut = g_strdup(in_folder("cut.html"));
    g_autofree char *text = NULL, *address = g_strconcat("file://", cut, NULL);
    g_free(process_mesorig(0, "export web %s -o %s", in_folder("small.exr"), page));
    g_assert_true(g_file_get_contents(page, &text, NULL, NULL));
    char *second = strstr(text, "<script>chunk(");
    g_assert_nonnull(second);
    char *end = strstr(second, "</script>\n");
    g_assert_nonnull(end);
    g_autofree char *without = g_strdup_printf("%.*s%s", (int)(second - text), text, end + 10);
    g_assert_true(g_file_set_contents(cut, without, -1, NULL));
    Browser *browser = the_browser();
    check_incomplete(browser, address);
    /* In the middle of a piece of the material, before the program. */
    g_assert_true(g_file_set_contents(cut, text, second - text + 100, NULL));
    check_incomplete(browser, address);
}

/* Opens a page that has the program of an exported page, but does not start it. The functions that
 * tests call are in the object “parts”. */
static Browser *open_program(void) {
    g_autofree char *one = g_strdup(in_folder("program.exr")), *text = NULL;
    g_autofree char *page = g_strdup(in_folder("program.html"));
    g_autofree char *address = g_strconcat("file://", page, NULL);
    webgl_test_write_constant(one, 0, LPCA_RGB);
    g_unlink(page);
    g_free(process_mesorig(0, "export web %s -o %s", one, page));
    g_assert_true(g_file_get_contents(page, &text, NULL, NULL));
    const char *begin = strstr(text, "<script type=\"module\">");
    const char *end = begin ? strstr(begin, "window.programBegan = true;") : NULL;
    g_assert_nonnull(end);
    g_autofree char *program =
        g_strdup_printf("<!doctype html>%.*s window.parts = { shapes, shapeStride, vertexShapes, "
                        "halveShell, Shell, readMaterial };</script>",
                        (int)(end - begin), begin);
    g_assert_true(g_file_set_contents(page, program, -1, NULL));
    Browser *browser = the_browser();
    browser_open(browser, address);
    browser_wait(browser, "window.parts !== undefined");
    return browser;
}

/* On the torus of radii 1 and r = 0.4, a step of u is 2π (1 + r cos b) long. The gradient of its
 * logarithm is −sin b / (1 + r cos b) along the bitangent, which runs along the angle b of the
 * tube. A step of v has the same length everywhere. */
TEST(stretch) {
    Browser *browser = open_program();
    g_autofree char *said = browser_value(
        browser, "(() => { const { vertices, indices } = parts.shapes.torus.make();"
                 "const shape = parts.vertexShapes(vertices, indices);"
                 "let worst = 0, most = 0;"
                 "for (let j = 3; j < 94; j++) for (let i = 3; i < 190; i++) {"
                 "  const b = 2 * Math.PI * j / 96, at = parts.shapeStride * (193 * j + i);"
                 "  const is = [0, -Math.sin(b) / (1 + 0.4 * Math.cos(b)), 0, 0];"
                 "  is.forEach((x, k) => {"
                 "    worst = Math.max(worst, Math.abs(shape[at + 5 + k] - x));"
                 "    most = Math.max(most, Math.abs(x)); });"
                 "} return `${worst} ${most}`; })()");
    g_auto(GStrv) numbers = g_strsplit(said, " ", 2);
    const double worst = g_ascii_strtod(numbers[0], NULL), most = g_ascii_strtod(numbers[1], NULL);
    g_test_message("stretch of the torus, up to %.3f: off by at most %.4f", most, worst);
    g_assert_cmpfloat(most, >, 1.0);
    g_assert_cmpfloat(worst, <, 0.01 * most);
}

/* The root of the mean square of each 2 × 2 voxels of a layer, here of two layers of 4 × 3. The
 * last row has no partner and does not count. */
TEST(mip_levels) {
    Browser *browser = open_program();
    g_autofree char *half = browser_value(
        browser, "String(parts.halveShell(new Uint8Array([10, 70, 0, 0, 50, 50, 0, 9, 1, 2, 3, "
                 "4, 255, 255, 3, 5, 255, 255, 4, 6, 5, 6, 7, 8]), 4, 3, 2))");
    /* √(100 + 4900 + 2500 + 2500) / 2 = 50, 9 / 2 to the even number, 255, √86 / 2 = 4.64 */
    g_assert_cmpstr(half, ==, "50,4,255,5");
    g_autofree char *column = browser_value(
        browser, "String(parts.halveShell(new Uint8Array([6, 8, 3, 4, 0, 1, 30, 40]), 1, 4, 2))");
    /* √((36 + 64) / 2) = 7.07, √(25 / 2) = 3.54, √(1 / 2) = 0.71, √(2500 / 2) = 35.4 */
    g_assert_cmpstr(column, ==, "7,4,1,35");
}

/* A file without sections, of this version and with this shell in its header. */
static void check_refused(Browser *browser, const char *version, const char *shell,
                          const char *words) {
    g_autofree char *expression = g_strdup_printf(
        "(() => { window.refused = null; const text = new TextEncoder();"
        "const header = text.encode('{\"sections\": [], \"shell\": %s}');"
        "const length = new Uint8Array(new Uint32Array([header.length]).buffer);"
        "parts.readMaterial(new Uint8Array([...text.encode('%s'), ...length, ...header]))"
        ".then(() => { window.refused = 'read'; }, error => { window.refused = error.message; });"
        "return 'asked'; })()",
        shell, version);
    g_free(browser_value(browser, expression));
    browser_wait(browser, "window.refused !== null");
    g_autofree char *said = browser_value(browser, "window.refused");
    assert_has(said, words);
}

TEST(damaged) {
    static const char *const shells[] = {
        "{}",
        "null, \"none\": 0",
        "{\"width\": 4, \"height\": 4, \"depth\": 4, \"width_mm\": 1, \"height_mm\": 1, "
        "\"depth_mm\": 1, \"top_mm\": 0, \"most_per_mm\": 1}",
        "{\"width\": 0, \"height\": 4, \"depth\": 4, \"width_mm\": 1, \"height_mm\": 1, "
        "\"depth_mm\": 1, \"top_mm\": 0, \"most_per_mm\": 1}",
        "{\"width\": 1e9, \"height\": 1e9, \"depth\": 1e9, \"width_mm\": 1, "
        "\"height_mm\": 1, \"depth_mm\": 1, \"top_mm\": 0, \"most_per_mm\": 1}",
    };
    Browser *browser = open_program();
    check_refused(browser, "mesoweb1", "{}", "has version 1 of the format, and only version 2");
    check_refused(browser, "mesowebX", "{}", "export it again");
    check_refused(browser, "mesorig2", "{}", "not a material that");
    for (gsize k = 0; k < G_N_ELEMENTS(shells); k++)
        check_refused(browser, "mesoweb2", shells[k], k == 1 ? "read" : "The material is damaged");
    check_refused(browser, "mesoweb2",
                  "null, \"along\": {\"width\": 4, \"height\": 4, \"views\": 3}",
                  "its views do not have the number and size");
    g_autofree char *large = browser_value(
        browser, "(() => { try { new parts.Shell({ gl: null, largest: 2048, mostLayers: 256 },"
                 "{ width: 64, height: 2049, depth: 1 }, null); } catch (error) { return "
                 "error.message; } })()");
    assert_has(large, "too large for this device");
}

BEFORE_TESTS {
    folder = g_dir_make_tmp("mesorig-webgl-XXXXXX", NULL);
    g_test_add_data_func("/webgl/pictures/weave", GINT_TO_POINTER(RELIEF_WEAVE), test_pictures);
    g_test_add_data_func("/webgl/pictures/bumps", GINT_TO_POINTER(RELIEF_BUMPS), test_pictures);
    g_test_add_data_func("/webgl/pictures/grooves", GINT_TO_POINTER(RELIEF_GROOVES), test_pictures);
}

AFTER_TESTS {
    browser_free(browser_of_all);
    remove_tree(folder);
    g_free(folder);
}
