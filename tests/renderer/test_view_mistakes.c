/* What mesorig-view says about materials that are cut off, incomplete or full of NaN, about shapes
 * that lack something, and about computers without OpenGL: one sentence, and never a crash or a
 * black picture. */
#include "codecs/codecs.h"
#include "codecs/lpca/lpca_levels.h"
#include "codecs/mdf_codecs/mdf_source.h"
#include "drawing/methods/methods.h"
#include "lib/fields_fixture.h"
#include "lib/mdf_file.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/skip.h"
#include "lib/test.h"
#include "lib/view_fixture.h"
#include "lib/x_display.h"

#include <dlfcn.h>
#include <glib/gstdio.h>
#include <link.h>
#include <sched.h>
#include <sys/mount.h>
#include <sys/wait.h>
#include <unistd.h>
#include <utime.h>

#define MESORIG BUILD_DIR "/bin/mesorig"
#define CUTS    20 /* places at which a file is torn */
#define NO_HIDE 77 /* exit code: files cannot be hidden here */

/* In the child, in a name space of its own: what these paths lead to is empty. */
static void hide(gpointer paths) {
    gboolean good = unshare(CLONE_NEWNS | (getuid() ? CLONE_NEWUSER : 0)) == 0 &&
                    mount("none", "/", NULL, MS_REC | MS_PRIVATE, NULL) == 0;
    for (const char *const *path = paths; good && *path != NULL; path++)
        good = mount("/dev/null", *path, NULL, MS_BIND, NULL) == 0;
    if (!good)
        _exit(NO_HIDE);
}

static int run_without(const char *const *hidden, const char *const *environment,
                       const char *const *arguments, char **ret_err) {
    g_auto(GStrv) all = g_get_environ();
    g_autofree char *out = NULL;
    int status;
    for (int k = 0; environment != NULL && environment[k] != NULL; k += 2)
        all = environment[k + 1] != NULL
                  ? g_environ_setenv(all, environment[k], environment[k + 1], TRUE)
                  : g_environ_unsetenv(all, environment[k]);
    ok(g_spawn_sync(NULL, (char **)arguments, all, G_SPAWN_SEARCH_PATH,
                    hidden != NULL ? hide : NULL, (gpointer)hidden, &out, ret_err, &status, ERR));
    g_assert_true(WIFEXITED(status));
    return WEXITSTATUS(status);
}

/* Exit code 1, and a sentence that has these words. */
static void refuses(const char *const *environment, const char *const *arguments,
                    const char *said) {
    g_autofree char *err = NULL;
    const int code = run_without(NULL, environment, arguments, &err);
    g_test_message("%s", err);
    g_assert_cmpint(code, ==, 1);
    g_assert_nonnull(strstr(err, "mesorig-view: ")); /* libraries may have said their own before */
    g_assert_nonnull(strstr(err, said));
}

static gboolean have_programs(void) {
    if (g_file_test(MESORIG, G_FILE_TEST_IS_EXECUTABLE))
        return view_fixture_have_program();
    test_skip_or_fail("mesorig is not built");
    return FALSE;
}

static void compress(const char *path, const char *const *options) {
    const char *words[12] = {"compress", path};
    for (int k = 0; options[k] != NULL; k++)
        words[k + 2] = options[k];
    g_autofree const char **argv = process_argv(MESORIG, words);
    g_free(process_text(0, argv));
}

/* What view_fixture_material() is the eigen-maps of. */
static struct btf_matrix *make_btf(void) {
    struct eigenmaps *m = view_fixture_material(LIGHT, 3, 4);
    struct btf_matrix *btf = g_new0(struct btf_matrix, 1);
    const int n = m->layout.views.n;
    *btf =
        (struct btf_matrix){.name = g_strdup("test"),
                            .layout.width = W,
                            .layout.height = H,
                            .layout.texel_mm = 1,
                            .layout.views.n = n,
                            .layout.lights.n = n,
                            .layout.views.theta_deg = g_steal_pointer(&m->layout.views.theta_deg),
                            .layout.views.phi_deg = g_steal_pointer(&m->layout.views.phi_deg),
                            .layout.lights.theta_deg = g_steal_pointer(&m->layout.lights.theta_deg),
                            .layout.lights.phi_deg = g_steal_pointer(&m->layout.lights.phi_deg)};
    btf->values = g_new(float, (gsize)W *H *n *n * 3);
    for (int texel = 0; texel < W * H; texel++)
        for (int k = 0; k < n * n; k++)
            fill_texel(LIGHT, 0,
                       direction_of_deg(btf->layout.lights.theta_deg[k % n],
                                        btf->layout.lights.phi_deg[k % n]),
                       texel % W, texel / W, btf->values + 3 * ((gsize)texel * n * n + k));
    eigenmaps_free(m);
    return btf;
}

static void write_lpca(const char *path, const struct btf_matrix *btf) {
    g_autoptr(GError) error = NULL;
    struct btf_matrix *half = btf_matrix_halved(btf);
    const struct btf_matrix *const levels[2] = {btf, half};
    const struct lpca_options options = {.n_clusters = 2, .n_components = 2, .work.n_threads = 1};
    struct lpca *lpca[2];
    for (int k = 0; k < 2; k++) {
        lpca[k] = ok(lpca_compute(levels[k], &options, ERR));
        lpca_quantise(lpca[k], LPCA_HALF);
    }
    g_assert_true(lpca_write_levels(path, lpca, 2, &error));
    lpca_free(lpca[0]);
    lpca_free(lpca[1]);
    btf_matrix_free(half);
}

/* As compress writes it, with as few components as the codec allows, and with a short training. */
static void write_model(const char *path, const struct btf_matrix *btf, const struct codec *codec) {
    g_autoptr(GError) error = NULL;
    const struct work work = {.n_threads = 1};
    g_autofree gpointer options = g_malloc0(codec->options_size);
    const struct codec_job job = {.btf = btf, .options = options, .work = &work};
    struct codec_result result = {0};
    options_defaults(codec->options, options);
    for (const struct option *option = codec->options; option->name != NULL; option++)
        if (g_str_equal(option->name, "components"))
            g_assert_true(options_set(option, "1", options, NULL) ||
                          options_set(option, "4", options, &error));
        else if (g_str_equal(option->name, "samples"))
            g_assert_true(options_set(option, "100", options, &error));
    g_assert_true(ok(codec->encode(codec, &job, &result, ERR)));
    g_assert_true(codec->write(path, result.levels->pdata, (int)result.levels->len, &error));
    g_ptr_array_unref(result.levels);
}

/* A session with every product that a method draws. */
static char *write_products(void) {
    char *session = view_fixture_write_session();
    struct btf_matrix *btf = make_btf();
    g_autofree char *lpca = method_path(method_find("lpca"), session);
    write_lpca(lpca, btf);
    for (int k = 0; codecs[k] != NULL; k++) {
        const struct method *method = method_find(codecs[k]->name);
        if (method == NULL)
            continue;
        g_autofree char *path = method_path(method, session);
        if (!g_file_test(path, G_FILE_TEST_EXISTS))
            write_model(path, btf, codecs[k]);
    }
    btf_matrix_free(btf);
    return session;
}

/* The opener of a method, or of distances. */
static gboolean opens(const struct method *method, const char *path, GError **error) {
    if (method == NULL) {
        struct mdf_source *mdf = mdf_source_read(path, error);
        const gboolean good = mdf != NULL;
        mdf_source_free(mdf);
        return good;
    }
    gpointer material = method_open(method, path, error);
    if (material != NULL)
        method->free(material);
    return material != NULL;
}

static void must_refuse(const struct method *method, const char *path, const char *what) {
    g_autoptr(GError) error = NULL, left = NULL;
    if (opens(method, path, &error))
        g_error("%s: %s was opened", path, what);
    g_assert_nonnull(error);
    if (strstr(error->message, path) == NULL)
        g_error("%s: %s: “%s” does not name the file", path, what, error->message);
    g_assert_true(gpu_check("what was left", &left));
}

static void tear(const struct method *method, const char *path) {
    g_autofree char *bytes = NULL;
    gsize length;
    g_assert_true(g_file_get_contents(path, &bytes, &length, NULL));
    g_autofree char *torn = g_strconcat(path, ".torn", NULL);
    const gsize firsts[] = {0, 1, 3, 4, 8, 40, length - 1};
    for (gsize k = 0; k < G_N_ELEMENTS(firsts) + CUTS; k++) {
        const gsize at = k < G_N_ELEMENTS(firsts)
                             ? firsts[k]
                             : length * (k - G_N_ELEMENTS(firsts) + 1) / (CUTS + 1);
        g_autofree char *what = g_strdup_printf("cut at byte %" G_GSIZE_FORMAT, at);
        g_assert_true(g_file_set_contents(torn, bytes, (gssize)at, NULL));
        must_refuse(method, torn, what);
    }
    g_unlink(torn);
}

static void write_all(const char *path, const struct exr_file *file) {
    ok(exr_write(path, file, EXR_NONE, FALSE, ERR));
}

/* One value of one plane after the other is none, or endless. */
static void poison(const struct method *method, const char *path, struct exr_file *file) {
    g_autofree char *bad = g_strconcat(path, ".bad", NULL);
    for (guint k = 0; k < file->parts->len; k++) {
        const struct exr_part *part = file->parts->pdata[k];
        for (int c = 0; c < part->n_channels; c++) {
            const gsize at = (gsize)part->width * part->height / 2;
            const float kept = part->planes[c][at];
            part->planes[c][at] = (k + (guint)c) % 2 == 0 ? NAN : INFINITY;
            write_all(bad, file);
            g_autofree char *what = g_strdup_printf("part %s, channel %s with %g", part->name,
                                                    part->channels[c], (double)part->planes[c][at]);
            /* Halves end at 65504. */
            if (part->type == EXR_FLOAT || isnan(part->planes[c][at]))
                must_refuse(method, bad, what);
            part->planes[c][at] = kept;
        }
    }
    g_unlink(bad);
}

/* optional: how many parts a file may lack and be opened all the same. */
static void lack(const struct method *method, const char *path, struct exr_file *file,
                 int optional) {
    g_autofree char *part_of = g_strconcat(path, ".part", NULL);
    GPtrArray *const all = file->parts;
    int opened = 0;
    for (guint k = 0; k < all->len; k++) {
        g_autoptr(GPtrArray) rest = g_ptr_array_new();
        g_autoptr(GError) error = NULL;
        for (guint i = 0; i < all->len; i++)
            if (i != k)
                g_ptr_array_add(rest, all->pdata[i]);
        if (rest->len == 0)
            continue;
        file->parts = rest;
        write_all(part_of, file);
        file->parts = all;
        const struct exr_part *part = all->pdata[k];
        if (opens(method, part_of, &error)) {
            g_test_message("%s is opened without its part %s", path, part->name);
            opened++;
        } else if (strstr(error->message, part_of) == NULL) {
            g_error("%s without %s: “%s” does not name the file", path, part->name, error->message);
        }
    }
    g_assert_cmpint(opened, <=, optional);
    g_unlink(part_of);
}

static void check_file(const struct method *method, const char *path, int optional) {
    g_autoptr(GError) error = NULL;
    if (!opens(method, path, &error))
        g_error("%s", error->message);
    tear(method, path);
    struct exr_file *file = ok(exr_read(path, ERR));
    poison(method, path, file);
    lack(method, path, file, optional);
    exr_file_free(file);
}

/* Whatever else draws the same file reads it alike. */
GPU_TEST(products) {
    g_autofree char *session = write_products();
    const char *last = "";
    for (int k = 0; methods[k] != NULL; k++) {
        if (methods[k]->product == NULL)
            continue;
        g_autofree char *path = method_path(methods[k], session);
        if (!g_str_equal(last, methods[k]->product))
            check_file(methods[k], path, 0);
        last = methods[k]->product;
    }
    remove_tree(session);
}

/* A session is drawn by its local PCA, unless its eigen-maps are newer. Without both it is drawn by
 * another method that it has a file for. Without any file the error names the eigen-maps. */
GPU_TEST(default_method) {
    if (!have_programs())
        return;
    g_autofree char *session = write_products();
    g_autofree char *picture = g_build_filename(session, "x.png", NULL);
    g_autofree char *lpca = method_path(method_find("lpca"), session);
    g_autofree char *maps = method_path(method_find("eigenmaps"), session);
    const char *argv[] = {VIEWER, session, "--render", picture, "--size", "16x12", NULL};
    g_autofree char *first = process_text(0, argv);
    g_assert_nonnull(strstr(first, lpca));
    GStatBuf made;
    g_assert_cmpint(g_stat(maps, &made), ==, 0);
    struct utimbuf before = {.actime = made.st_mtime - 60, .modtime = made.st_mtime - 60};
    g_assert_cmpint(g_utime(lpca, &before), ==, 0);
    for (int k = 0; methods[k] != NULL; k++) {
        if (methods[k]->product == NULL)
            continue;
        g_autofree char *path = method_path(methods[k], session);
        if (!g_file_test(path, G_FILE_TEST_EXISTS))
            continue; /* drawn by a method before, and removed */
        g_autofree char *said = process_text(0, argv);
        g_assert_nonnull(strstr(said, path));
        g_assert_cmpint(unlink(path), ==, 0);
    }
    refuses(NULL, argv, "eigenmaps.exr; “mesorig process” makes it");
    remove_tree(session);
}

/* A file of a codec that has no drawing method, or that a newer version wrote. */
GPU_TEST(no_method) {
    if (!have_programs())
        return;
    static const char *const words[] = {"new.exr is of the kind “wavelets”",
                                        "there is no drawing method"};
    g_autofree char *session = view_fixture_write_session();
    g_autofree char *path = method_path(method_find("eigenmaps"), session);
    g_autofree char *new = g_build_filename(session, "new.exr", NULL);
    g_autofree char *picture = g_build_filename(session, "x.png", NULL);
    struct exr_file *file = ok(exr_read(path, ERR));
    for (guint k = 0; k < file->parts->len; k++)
        exr_set_string(file->parts->pdata[k], "mesorig.kind", "wavelets");
    write_all(new, file);
    exr_file_free(file);
    for (gsize k = 0; k < G_N_ELEMENTS(words); k++) {
        refuses(NULL, (const char *[]){VIEWER, new, "--render", picture, NULL}, words[k]);
        refuses(NULL, (const char *[]){VIEWER, new, "--method", "ward", "--render", picture, NULL},
                words[k]);
    }
    remove_tree(session);
}

static char *write_mdf(const char *session, int width, int height) {
    struct exr_file *file = exr_file_new();
    for (int k = 0; k < 12; k++) {
        struct exr_part *part =
            mdf_file_add_view(file, k, width, height, k < 6 ? 30.0 : 70.0, 60.0 * (k % 6), 0.5);
        for (int i = 0; i < width * height; i++)
            part->planes[0][i] = 1.0F + (float)((i + k) % 5) / 10.0F;
        exr_set_double(part, "reference_mm", 2.0);
    }
    char *path = g_build_filename(session, "products", "mdf.exr", NULL);
    write_all(path, file);
    exr_file_free(file);
    return path;
}

GPU_TEST(distances) {
    if (!have_programs())
        return;
    g_autofree char *session = view_fixture_write_session();
    g_autofree char *plain = write_mdf(session, 8, 8);
    g_autofree char *maps = g_build_filename(session, "products", "maps.exr", NULL);
    g_autofree char *views = g_build_filename(session, "products", "views.exr", NULL);
    compress(plain, (const char *[]){"--method", "mdf", "--components", "4", "-o", maps, NULL});
    compress(plain, (const char *[]){"--method", "mdf-views", "-o", views, NULL});
    check_file(NULL, plain, 12); /* any number of views will do */
    check_file(NULL, maps, 0);
    check_file(NULL, views, 12);
    remove_tree(session);
}

#define WIDE 40000 /* texels: more than llvmpipe and today's cards take each way */

static void write_wide_maps(const char *path) {
    struct eigenmaps *m = view_fixture_material(LIGHT, 1, 3);
    m->layout.width = WIDE;
    m->layout.height = m->n_terms = 1;
    g_free(m->maps);
    m->maps = g_new0(float, m->layout.lights.n *WIDE * 3);
    ok(eigenmaps_write(path, m, ERR));
    eigenmaps_free(m);
}

static void write_wide_lpca(const char *path, const struct btf_matrix *btf) {
    g_autoptr(GError) error = NULL;
    const struct lpca_options options = {.n_clusters = 2, .n_components = 2, .work.n_threads = 1};
    struct lpca *lpca = ok(lpca_compute(btf, &options, ERR));
    lpca->layout.width = WIDE;
    lpca->layout.height = 1;
    g_free(lpca->clusters);
    g_free(lpca->weights);
    lpca->clusters = g_new0(int, WIDE);
    lpca->weights = g_new0(float, (gsize)WIDE * lpca->n_components);
    lpca_quantise(lpca, LPCA_HALF);
    g_assert_true(lpca_write_levels(path, &lpca, 1, &error));
    lpca_free(lpca);
}

static void is_too_wide(const char *path, const GError *error) {
    g_assert_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE);
    g_test_message("%s", error->message);
    g_assert_nonnull(strstr(error->message, path));
    g_assert_nonnull(strstr(error->message, "40000 × 1 texels"));
}

/* More than the card takes. */
GPU_TEST(too_wide) {
    static const char *const names[] = {"eigenmaps", "fields",       "lpca",
                                        "lpca-grid", "lpca-revised", NULL};
    g_autofree char *session = view_fixture_write_session(), *mdf = write_mdf(session, WIDE, 1);
    for (int k = 0; names[k] != NULL; k++) {
        g_autoptr(GError) error = NULL;
        g_autofree char *path = method_path(method_find(names[k]), session);
        if (g_str_equal(names[k], "eigenmaps"))
            write_wide_maps(path);
        else if (g_str_equal(names[k], "fields"))
            fields_fixture_write(path, WIDE, 1);
        else if (g_str_equal(names[k], "lpca")) {
            struct btf_matrix *btf = make_btf();
            write_wide_lpca(path, btf);
            btf_matrix_free(btf);
        }
        g_assert_false(opens(method_find(names[k]), path, &error));
        is_too_wide(path, error);
    }
    g_autoptr(GError) error = NULL, wide = NULL;
    g_autoptr(Viewer) viewer = viewer_new(NULL, &error);
    g_assert_no_error(error);
    g_assert_false(viewer_open_mdf(viewer, mdf, &wide));
    is_too_wide(mdf, wide);
    g_assert_true(gpu_check("what was left", &error));
    remove_tree(session);
}

/* Where a driver has less than is needed, or there is none. */
GPU_TEST(no_gl) {
    if (!have_programs())
        return;
    g_autofree char *dir = view_fixture_write_session();
    g_autofree char *path = g_build_filename(dir, "out.png", NULL);
    const char *const render[] = {VIEWER, dir, "-o", path, "--size", "48x32", NULL};
    refuses((const char *[]){"MESA_GL_VERSION_OVERRIDE", "3.0", NULL}, render,
            "LIBGL_ALWAYS_SOFTWARE=1");
    refuses((const char *[]){"__EGL_VENDOR_LIBRARY_FILENAMES", "/nonexistent", NULL}, render,
            "libegl-mesa0");
    refuses((const char *[]){"EGL_PLATFORM", "x11", "LIBGL_DRIVERS_PATH", "/nonexistent", NULL},
            render, "libgl1-mesa-dri");
    g_assert_false(g_file_test(path, G_FILE_TEST_EXISTS));
    remove_tree(dir);
}

/* Where a library lies; it must be there. */
static char *find_library(const char *name) {
    void *library = dlopen(name, RTLD_LAZY | RTLD_LOCAL);
    struct link_map *map = NULL;
    if (library == NULL)
        g_error("%s", dlerror());
    g_assert_cmpint(dlinfo(library, RTLD_DI_LINKMAP, &map), ==, 0);
    char *path = realpath(map->l_name, NULL);
    dlclose(library);
    return path;
}

struct missing {
    const char *libraries[3];
    const char *said; /* NULL: it draws all the same */
};

static void check_missing(const struct missing *m, const char *const *environment,
                          const char *const *arguments) {
    char *paths[G_N_ELEMENTS(m->libraries)] = {NULL};
    g_autofree char *err = NULL;
    for (int k = 0; m->libraries[k] != NULL; k++)
        paths[k] = find_library(m->libraries[k]);
    const int code = run_without((const char *const *)paths, environment, arguments, &err);
    for (int k = 0; paths[k] != NULL; k++)
        free(paths[k]);
    g_test_message("without %s: %d: %s", m->libraries[0], code, err);
    if (code == NO_HIDE) {
        test_skip_or_fail("files cannot be hidden: no name spaces of mounts");
        return;
    }
    g_assert_cmpint(code, ==, m->said != NULL ? 1 : 0);
    if (m->said != NULL) {
        g_assert_true(g_str_has_prefix(err, "mesorig-view: "));
        g_assert_nonnull(strstr(err, m->said));
    }
}

/* Libraries that are not installed. */
GPU_TEST(no_library) {
    static const struct missing headless[] = {
        {{"libEGL.so.1"}, "install EGL and Mesa (libegl1"},
        {{"libOpenGL.so.0", "libGL.so.1"}, "install libgl1"},
        {{"libGL.so.1"}, NULL},
        {{"libOpenGL.so.0"}, NULL},
        {{"libEGL_mesa.so.0"}, "libegl-mesa0"},
    };
    static const struct missing window[] = {
        {{"libGL.so.1"}, "install libgl1"},
        {{"libGLX.so.0"}, "install libgl1"},
        {{"libGLX_mesa.so.0"}, "LIBGL_ALWAYS_SOFTWARE=1"},
        {{"libEGL.so.1"}, NULL},
    };
    if (!have_programs())
        return;
    g_autofree char *dir = view_fixture_write_session();
    g_autofree char *path = g_build_filename(dir, "out.png", NULL);
    const char *const render[] = {VIEWER, dir, "-o", path, "--size", "48x32", NULL};
    const char *const show[] = {VIEWER, dir, "--size", "48x32", "--close-after", "1", NULL};
    for (gsize k = 0; k < G_N_ELEMENTS(headless); k++)
        check_missing(&headless[k], NULL, render);
    g_autoptr(XDisplay) x = x_display_new();
    for (gsize k = 0; x != NULL && k < G_N_ELEMENTS(window); k++)
        check_missing(&window[k], (const char *[]){"DISPLAY", x_display_name(x), NULL}, show);
    remove_tree(dir);
}

struct shape {
    const char *name, *text, *said;
};

static void test_shapes(gconstpointer data) {
    static const struct shape shapes[] = {
        {"bare.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "no texture coordinates (vt)"},
        {"nan.obj", "v 0 nan 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n", "nan.obj:1"},
        {"empty.obj", "", "empty.obj"},
        {"torn.gltf", "{\"asset\": {\"version\": \"2.0\"}, \"mesh", "torn.gltf"},
        {"bare.gltf",
         "{\"asset\":{\"version\":\"2.0\"},\"meshes\":[{\"primitives\":[{\"attributes\":"
         "{\"POSITION\":0}}]}],\"nodes\":[{\"mesh\":0}],\"scenes\":[{\"nodes\":[0]}],"
         "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"}],"
         "\"bufferViews\":[{\"buffer\":0,\"byteLength\":36}],\"buffers\":[{\"byteLength\":36,"
         "\"uri\":\"data:application/octet-stream;base64,"
         "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA\"}]}",
         "no texture coordinates (TEXCOORD_0)"},
    };
    if (!have_programs())
        return;
    g_autofree char *dir = view_fixture_write_session();
    g_autofree char *path = g_build_filename(dir, "out.png", NULL);
    for (gsize k = 0; k < G_N_ELEMENTS(shapes); k++) {
        g_autofree char *shape = g_build_filename(dir, shapes[k].name, NULL);
        g_assert_true(g_file_set_contents(shape, shapes[k].text, -1, NULL));
        refuses(NULL, (const char *[]){VIEWER, dir, "-o", path, "--shape", shape, NULL},
                shapes[k].said);
    }
    g_assert_false(g_file_test(path, G_FILE_TEST_EXISTS));
    remove_tree(dir);
}

/* Without the package's sample. */
TEST(no_sample) {
    if (!view_fixture_have_program())
        return;
    const char *arguments[] = {VIEWER, "--sample", "-o", "out.png", NULL, NULL};
    g_autofree char *err = NULL;
    if (!g_file_test("/usr/local/share/mesorig/sample/weave.exr", G_FILE_TEST_EXISTS) &&
        !g_file_test(SOURCE_DIR "/demo/weave.session", G_FILE_TEST_EXISTS)) {
        g_assert_cmpint(run_without(NULL, NULL, arguments, &err), ==, 2);
        g_assert_nonnull(strstr(err, "etc/sample/make"));
    }
    g_autofree char *both = NULL;
    arguments[4] = "cloth.session";
    g_assert_cmpint(run_without(NULL, NULL, arguments, &both), ==, 2);
    g_assert_nonnull(strstr(both, "leave out cloth.session"));
}

/* OpenGL 3.3 is enough, for silhouettes too; what needs more says so. */
GPU_TEST(least_gl) {
    if (!have_programs())
        return;
    g_autofree char *dir = view_fixture_write_session();
    g_autofree char *mdf = write_mdf(dir, 8, 8);
    g_autofree char *path = g_build_filename(dir, "out.png", NULL);
    static const char *const least[] = {"MESA_GL_VERSION_OVERRIDE", "3.3", NULL};
    const char *arguments[] = {
        VIEWER,          dir, "--silhouettes=lists", "-o",     path,    "--size", "48x32",
        "--supersample", "1", "--shadows",           "--lamp", "30,90", NULL};
    refuses(least, arguments, "OpenGL 4.3");
    arguments[2] = "--silhouettes";
    guint8 *rgb[2];
    int different = 0, width, height;
    for (int k = 0; k < 2; k++) {
        g_autofree char *err = NULL;
        if (run_without(NULL, k == 0 ? NULL : least, arguments, &err) != 0)
            g_error("%s", err);
        rgb[k] = view_fixture_read_png(path, &width, &height);
    }
    for (int k = 0; k < 3 * width * height; k++)
        different += ABS(rgb[0][k] - rgb[1][k]) > 2;
    g_assert_cmpint(different, <=, 3 * width * height / 500);
    g_free(rgb[0]);
    g_free(rgb[1]);
    remove_tree(dir);
}

BEFORE_TESTS {
    gpu_fixture_add("/view-mistakes/shapes", test_shapes, NULL);
}
