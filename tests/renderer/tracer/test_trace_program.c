/* mesorig-trace as its users call it: files it writes, captured materials, and what it refuses. */
#include "exr/exr.h"
#include "lib/folder.h"
#include "lib/material_fixture.h"
#include "lib/process.h"
#include "lib/test.h"
#include "lib/trace_fixture.h"

#include <glib/gstdio.h>
#include <json-glib/json-glib.h>
#include <math.h>
#include <png.h>
#include <string.h>

#define TRACE BUILD_DIR "/bin/mesorig-trace"

static void write_scene(const char *name, const char *materials, gboolean bare) {
    g_autoptr(Mesh) sphere = scene_sphere();
    g_autoptr(Mesh) plane = scene_plane();
    const struct trace_object objects[] = {{sphere, 0, 1.0F, {0, 0, 1}, bare},
                                           {plane, 1, 4.0F, {0, 0, 0}, FALSE}};
    g_autofree char *text = trace_fixture_text(objects, 2, materials, "", "", 0);
    g_autofree char *path = in_folder(name);
    g_assert_true(g_file_set_contents(path, text, -1, NULL));
}

#define MATERIALS "{\"name\": \"cloth\"}, {\"name\": \"floor\"}"

/* Runs mesorig-trace in the folder with arguments that blanks separate; its output and errors. */
static char *trace(int code, const char *arguments) {
    g_auto(GStrv) words = g_strsplit(arguments, " ", -1);
    g_autofree const char **argv = process_argv(TRACE, (const char *const *)words);
    char *out = NULL, *err = NULL;
    g_assert_cmpint(process_run_in(folder, argv, &out, &err), ==, code);
    char *both = g_strconcat(out, err, NULL);
    g_free(out);
    g_free(err);
    return both;
}

static double json_number(const char *text, const char *name) {
    g_autoptr(JsonParser) parser = json_parser_new();
    g_assert_true(json_parser_load_from_data(parser, text, -1, NULL));
    return json_object_get_double_member(json_node_get_object(json_parser_get_root(parser)), name);
}

static void write_material(void) {
    g_autoptr(BtfMatrix) btf = material_fixture_btf(TRUE);
    g_autofree char *path = in_folder("cloth.exr");
    material_fixture_write(path, codecs_find("lpca"), btf, "clusters=3 components=4");
}

/* A picture with a captured material: the PNG is the EXR's radiance, exposed; both ways of drawing
 * directions see the same material. */
TEST(picture) {
    g_autofree char *exr_path = in_folder("a.exr"), *png_path = in_folder("a.png");
    g_autoptr(GError) error = NULL;
    g_autofree char *said =
        trace(0, "a.gltf -o a.png --exr a.exr --material cloth=cloth.exr,3 --environment studio "
                 "--camera -60,35 --size 32x24 --samples 48 --json");
    g_autofree char *evenly =
        trace(0, "a.gltf -o b.png --material cloth=cloth.exr,3 --environment studio "
                 "--camera -60,35 --size 32x24 --samples 48 --json --even --seed 5");
    g_autoptr(ExrFile) file = exr_read(exr_path, &error);
    g_assert_no_error(error);
    const struct exr_part *part = exr_file_part(file, "picture");
    const struct exr_part *variance = exr_file_part(file, "variance");
    g_assert_true(part && variance && part->width == 32 && part->height == 24);
    png_image image = {.version = PNG_IMAGE_VERSION};
    guint8 rgb[32 * 24 * 3];
    g_assert_true(png_image_begin_read_from_file(&image, png_path));
    image.format = PNG_FORMAT_RGB;
    g_assert_true(image.width == 32 && image.height == 24);
    g_assert_true(png_image_finish_read(&image, NULL, rgb, 0, NULL));
    double sum = 0.0;
    for (int k = 0; k < 32 * 24; k++)
        for (int c = 0; c < 3; c++) {
            const double radiance = (double)exr_part_plane(part, c == 0   ? "R"
                                                                 : c == 1 ? "G"
                                                                          : "B")[k];
            const double shown = 0.8 * radiance;
            g_assert_true(isfinite(radiance) && radiance >= 0.0);
            sum += radiance / (32 * 24 * 3);
            if (shown < 0.8 && shown > 0.01) /* below the shoulder of the tone curve */
                g_assert_cmpfloat_with_epsilon(pow((rgb[3 * k + c] / 255.0 + 0.055) / 1.055, 2.4),
                                               shown, 0.006);
        }
    g_assert_cmpfloat_with_epsilon(sum, json_number(said, "mean_radiance"), 1e-4);
    const double n = 32 * 24 * 48;
    const double off =
        3.0 *
        sqrt((json_number(said, "sample_variance") + json_number(evenly, "sample_variance")) / n);
    g_assert_cmpfloat_with_epsilon(sum, json_number(evenly, "mean_radiance"), off + 0.005 * sum);
}

/* The same command gives the same bytes. */
TEST(again) {
    static const char arguments[] = "a.gltf -o c.png --material cloth=cloth.exr --lamp 40,30,2 "
                                    "--size 16x16 --samples 4 --threads ";
    g_autofree char *path = in_folder("c.png"), *bytes[2] = {NULL, NULL};
    gsize sizes[2];
    for (int k = 0; k < 2; k++) {
        g_autofree char *whole = g_strdup_printf("%s%d", arguments, k + 1);
        g_autofree char *said = trace(0, whole);
        assert_has(said, "16 × 16 pixels, 4 samples");
        g_assert_true(g_file_get_contents(path, &bytes[k], &sizes[k], NULL));
    }
    g_assert_cmpmem(bytes[0], sizes[0], bytes[1], sizes[1]);
    g_free(bytes[1]);
}

/* The scene of docs/artists/path-tracing.md, with its camera and two captured materials. */
TEST(documented) {
    g_autofree char *scene = in_folder("two.gltf");
    const char *const argv[] = {SOURCE_DIR "/etc/sample/make_scene", scene, NULL};
    g_autofree char *made = process_text(0, argv);
    g_autofree char *said =
        trace(0, "two.gltf -o two.png --material vase=cloth.exr,3 --material bowl=cloth.exr,2 "
                 "--environment studio --size 32x20 --samples 2 --json");
    g_assert_cmpfloat(json_number(said, "triangles"), ==, 150928);
    g_assert_cmpfloat(json_number(said, "mean_radiance"), >, 0.05);
}

/* The scenes of docs/artists/viewer.md. */
TEST(documented_kinds) {
    static const char *const kinds[] = {"tori", "knot"};
    for (gsize k = 0; k < G_N_ELEMENTS(kinds); k++) {
        g_autofree char *scene = in_folder("kind.gltf");
        const char *const argv[] = {SOURCE_DIR "/etc/sample/make_scene", scene, kinds[k], NULL};
        g_autofree char *made = process_text(0, argv);
        g_autofree char *arguments =
            g_strdup_printf("kind.gltf -o kind%zu.png --material %s=cloth.exr --environment studio "
                            "--size 16x10 --samples 2",
                            k, kinds[k]);
        g_autofree char *said = trace(0, arguments);
        g_test_message("%s", said);
        assert_has(said, "16 × 10 pixels, 2 samples");
    }
}

/* Each ends with a sentence that names what is wrong, and without a file. */
TEST(mistakes) {
    static const struct {
        int code;
        const char *arguments, *says;
    } cases[] = {
        {2, "a.gltf", "no picture is named"},
        {2, "-o x.png", "an argument is missing"},
        {2, "a.gltf -o x.png --sampels 3", "did you mean --samples?"},
        {2, "a.gltf -o x.png", "the scene has no light"},
        {2, "a.gltf -o x.png --environment studio --size 12", "--size 12: give WIDTHxHEIGHT"},
        {2, "a.gltf -o x.png --environment nosuch",
         "--environment=nosuch: there is no file of that name; choose from: white, studio"},
        {2, "a.gltf -o x.png --environment studio --size 0x5",
         "width: 0 is out of range: 1 to 16384"},
        {2, "a.gltf -o x.png --environment studio --samples 0", "samples: 0 is out of range"},
        {2, "a.gltf -o x.png --environment studio --depth -1", "depth: -1 is out of range"},
        {2, "a.gltf -o x.png --lamp 20", "--lamp 20: give 2 to 3 numbers"},
        {2, "a.gltf -o x.png --lamp 20,0,-3", "must not be negative"},
        {2, "a.gltf -o x.png --environment studio --camera 1,2,nan", "--camera 1,2,nan"},
        {2, "a.gltf -o x.png --environment studio --camera 1,95", "ELEVATION must be"},
        {1, "a.gltf -o no/x.png --environment studio", "there is no folder no; make it first"},
        {2, "a.gltf -o x.png --environment studio --material cloth", "NAME=PATH"},
        {2, "a.gltf -o x.png --environment studio --material cloth=cloth.exr,0",
         "0 tiles are not possible"},
        {1, "a.gltf -o x.png --environment studio --material silk=cloth.exr",
         "no material “silk”; its materials are “cloth”"},
        {1, "a.gltf -o x.png --environment studio --material cloth=none.exr", "none.exr"},
        {1, "a.gltf -o x.png --environment studio --material cloth=a.gltf", "a.gltf"},
        {1, "bare.gltf -o x.png --environment studio --material cloth=cloth.exr",
         "no texture coordinates"},
        {1, "none.gltf -o x.png --environment studio", "none.gltf"},
        {1, "cloth.exr -o x.png --environment studio", "cloth.exr: not glTF"},
        {1, "a.gltf -o x.png --environment cloth.exr", "cloth.exr"},
        {1, "far.gltf -o x.png --environment studio", "scale the scene"},
        {1, "lamp.gltf -o x.png --environment studio", "names lamp 3"},
        {1, "names.gltf -o x.png --environment studio", "names material 7, but the file has 2"},
    };
    g_autofree char *path = in_folder("x.png"), *far = in_folder("far.gltf");
    g_autofree char *lamp = in_folder("lamp.gltf"), *names = in_folder("names.gltf");
    g_autoptr(Mesh) plane = scene_plane();
    const struct trace_object away = {plane, 0, 1.0F, {1e8F, 0, 0}, FALSE};
    const struct trace_object other = {plane, 7, 1.0F, {0, 0, 0}, FALSE};
    const struct trace_object here = {plane, 0, 1.0F, {0, 0, 0}, FALSE};
    g_autofree char *far_text = trace_fixture_text(&away, 1, MATERIALS, "", "", 0);
    g_autofree char *names_text = trace_fixture_text(&other, 1, MATERIALS, "", "", 0);
    g_autofree char *lamp_text =
        trace_fixture_text(&here, 1, MATERIALS, "",
                           ", {\"extensions\": {\"KHR_lights_punctual\": {\"light\": 3}}}", 1);
    g_assert_true(g_file_set_contents(far, far_text, -1, NULL));
    g_assert_true(g_file_set_contents(lamp, lamp_text, -1, NULL));
    g_assert_true(g_file_set_contents(names, names_text, -1, NULL));
    write_scene("bare.gltf", MATERIALS, TRUE);
    for (gsize k = 0; k < G_N_ELEMENTS(cases); k++) {
        g_autofree char *said = trace(cases[k].code, cases[k].arguments);
        assert_has(said, cases[k].says);
        g_assert_false(g_file_test(path, G_FILE_TEST_EXISTS));
    }
}

/* A picture that cannot be written leaves the one that was there. */
TEST(full) {
    g_autofree char *path = in_folder("kept.png"), *bytes = NULL;
    g_autofree char *script =
        g_strdup_printf("ulimit -f 1; trap '' XFSZ; exec " TRACE
                        " a.gltf -o kept.png --environment studio --size 64x64 --samples 1");
    const char *const argv[] = {"/bin/sh", "-c", script, NULL};
    g_autofree char *err = NULL;
    g_assert_true(g_file_set_contents(path, "before", -1, NULL));
    g_assert_cmpint(process_run_in(folder, argv, NULL, &err), ==, 1);
    assert_has(err, "kept.png");
    g_assert_true(g_file_get_contents(path, &bytes, NULL, NULL));
    g_assert_cmpstr(bytes, ==, "before");
    g_autoptr(GDir) dir = g_dir_open(folder, 0, NULL);
    const char *name;
    while ((name = g_dir_read_name(dir)) != NULL)
        g_assert_true(!g_str_has_prefix(name, "kept.png.") && !g_str_has_prefix(name, "kept.png~"));
}

BEFORE_TESTS {
    folder_make();
    write_scene("a.gltf", MATERIALS, FALSE);
    write_material();
}

AFTER_TESTS {
    folder_remove();
}
