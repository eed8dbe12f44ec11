/* Every kind of export, of damaged or incomplete materials and to faulty disks: the result is a
 * file, or a sentence that says what is wrong, without a file. */
#include "lib/material_fixture.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/skip.h"
#include "lib/test.h"

#include <glib/gstdio.h>
#include <math.h>
#include <string.h>
#include <sys/mount.h>

/* What lacks: an export that needs it says so. */
enum need { ONE_VIEW, MANY_VIEWS, RELIEF, LIGHTS };

static const struct kind {
    const char *name, *end;
    enum need need;
} kinds[] = {{"btf", ".btf", ONE_VIEW},       {"points", ".ply", RELIEF},
             {"mesh", ".ply", RELIEF},        {"mesh", ".obj", RELIEF},
             {"mesh", ".glb", RELIEF},        {"height", ".exr", LIGHTS},
             {"normals", ".exr", LIGHTS},     {"web", ".html", ONE_VIEW},
             {"web", ".mesoweb", ONE_VIEW},   {"maps", "", ONE_VIEW},
             {"gltf", ".glb", ONE_VIEW},      {"gltf", ".gltf", ONE_VIEW},
             {"materialx", "", ONE_VIEW},     {"usd", "", ONE_VIEW},
             {"blender", "", ONE_VIEW},       {"bsdf --isotropic", ".bsdf", MANY_VIEWS},
             {"merl", ".binary", MANY_VIEWS}, {"ptm", ".ptm", ONE_VIEW},
             {"relight", "", ONE_VIEW}};

static const char *const materials[] = {"holes", "one", "photos", "text", "gone"};

static char *folder;

static int by_name(gconstpointer a, gconstpointer b) {
    return strcmp(*(const char *const *)a, *(const char *const *)b);
}

/* What lies in a folder below the test's; g_free() it. */
static char *listed(const char *name) {
    g_autofree char *path = g_build_filename(folder, name, NULL);
    g_autoptr(GPtrArray) names = g_ptr_array_new_with_free_func(g_free);
    g_autoptr(GDir) dir = g_dir_open(path, 0, NULL);
    const char *one;
    while ((one = g_dir_read_name(dir)))
        g_ptr_array_add(names, g_strdup(one));
    g_ptr_array_sort(names, by_name);
    g_ptr_array_add(names, NULL);
    return g_strjoinv(" ", (char **)names->pdata);
}

/* Where a kind of export of a material writes to: into a folder of the material. */
static char *output_of(const struct kind *kind, const char *material) {
    return g_strdup_printf("%s/a_%.4s%s", material, kind->name, kind->end);
}

static char *refused(const struct kind *kind, const char *session, const char *to,
                     const char *words) {
    g_autofree char *out = g_path_get_dirname(to), *before = listed(out);
    g_autofree char *said = process_mesorig(1, "export %s %s -o %s", kind->name, session, to);
    g_autofree char *after = listed(out);
    assert_has(said, words);
    g_assert_cmpstr(before, ==, after);
    return g_steal_pointer(&said);
}

static void made(const struct kind *kind, const char *material) {
    g_autofree char *session = g_strconcat(material, ".session", NULL);
    g_autofree char *to = output_of(kind, material);
    g_free(process_mesorig(0, "export %s %s -o %s", kind->name, session, to));
    g_assert_true(g_file_test(to, G_FILE_TEST_EXISTS));
    /* Pages and EXR files say that Mesorig has written them. */
    if (!g_str_equal(kind->end, ".html") && !g_str_equal(kind->end, ".exr")) {
        g_free(refused(kind, session, to, "exists already: give another name, or --force"));
        return;
    }
    g_autofree char *again = process_mesorig(0, "export %s %s -o %s", kind->name, session, to);
    assert_has(again, "it replaces the “");
    assert_has(again, "that Mesorig had written there");
}

static void refused_session(const struct kind *kind, const char *material, const char *words) {
    g_autofree char *session = g_strconcat(material, ".session", NULL);
    g_autofree char *to = output_of(kind, material);
    g_free(refused(kind, session, to, words));
}

static void write_session(const char *name, int rings, gboolean holes) {
    g_autoptr(BtfMatrix) btf = material_fixture_sized(MATERIAL_WIDTH, MATERIAL_HEIGHT, rings, TRUE);
    g_autofree char *session = g_build_filename(folder, name, NULL);
    const gsize texel = btf->layout.views.n * btf->layout.lights.n * 3;
    for (gsize i = 0; i < texel * MATERIAL_WIDTH * MATERIAL_HEIGHT && holes; i++)
        if (i / 3 % 7 == 3 || i / texel == 4) /* values here and there, and all of one texel */
            btf->values[i] = NAN;
    material_fixture_write_session(session, btf);
}

/* Holes, and no MDF. */
TEST(holes) {
    write_session("holes.session", 2, TRUE);
    for (gsize i = 0; i < G_N_ELEMENTS(kinds); i++)
        if (kinds[i].need == RELIEF)
            refused_session(&kinds[i], "holes", "there is no MDF");
        else if (!g_str_equal(kinds[i].name, "merl")) /* the mean is that of bsdf; seconds less */
            made(&kinds[i], "holes");
}

TEST(one_view) {
    write_session("one.session", 0, FALSE);
    for (gsize i = 0; i < G_N_ELEMENTS(kinds); i++)
        if (kinds[i].need == RELIEF)
            refused_session(&kinds[i], "one", "there is no MDF");
        else if (kinds[i].need == LIGHTS)
            refused_session(&kinds[i], "one", "normals need at least three lights");
        else if (kinds[i].need == MANY_VIEWS)
            refused_session(&kinds[i], "one", "a BRDF needs 4 of each or more");
        else if (g_str_equal(kinds[i].name, "ptm") || g_str_equal(kinds[i].name, "relight"))
            refused_session(&kinds[i], "one", "do not determine the six terms");
        else
            made(&kinds[i], "one");
}

TEST(no_session) {
    g_assert_cmpint(g_mkdir("photos.session", 0777), ==, 0);
    g_assert_true(g_file_set_contents("text.session", "not a folder", -1, NULL));
    for (gsize i = 0; i < G_N_ELEMENTS(kinds); i++) {
        refused_session(&kinds[i], "photos", "photos.session");
        refused_session(&kinds[i], "text", "text.session");
        refused_session(&kinds[i], "gone", "gone.session");
    }
}

TEST(full_disk) {
    g_assert_cmpint(g_mkdir("disk", 0777), ==, 0);
    if (mount("mesorig-test", "disk", "tmpfs", 0, "size=16k") != 0) {
        test_skip_or_fail("a disk cannot be mounted here");
        return;
    }
    write_session("whole.session", 2, FALSE);
    static const char filler[16 * 1024];
    FILE *file = g_fopen("disk/filler", "w");
    g_assert_nonnull(file);
    fwrite(filler, 1, sizeof filler, file);
    fclose(file);
    for (gsize i = 0; i < G_N_ELEMENTS(kinds); i++) {
        g_autofree char *to = g_strdup_printf("disk/a%s", kinds[i].end);
        if (kinds[i].need == RELIEF)
            continue;
        g_autofree char *said = refused(&kinds[i], "whole.session", to, "No space left on device");
        assert_has(said,
                   "disk/"); /* the file that did not fit: that of the option, or one next to it */
    }
    g_assert_cmpint(umount2("disk", MNT_DETACH), ==, 0);
}

BEFORE_TESTS {
    folder = g_dir_make_tmp("mesorig-trouble-XXXXXX", NULL);
    g_assert_cmpint(g_chdir(folder), ==, 0);
    for (gsize i = 0; i < G_N_ELEMENTS(materials); i++)
        g_assert_cmpint(g_mkdir(materials[i], 0777), ==, 0);
}

AFTER_TESTS {
    remove_tree(folder);
    g_free(folder);
}
