/* mesorig check: what it suspects if pictures were imported with a wrong tone curve, and that it
 * suspects nothing if the tone curve is right. The truth is Lambert's law: B = ρ cos θ_l. */
#include "exr/exr.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/small_rig.h"
#include "lib/test.h"

#include <glib/gstdio.h>
#include <math.h>
#include <png.h>
#include <sqlite3.h>
#include <string.h>

#define SIDE 8

static char *folder;

static double encode(double light) {
    return light <= 0.0031308 ? 12.92 * light : 1.055 * pow(light, 1 / 2.4) - 0.055;
}

struct tone {
    const char *name;
    int bits;
    gboolean srgb; /* the file's values are */
    double scale, black;
    const char *says; /* NULL: nothing is suspected */
};

static void write_picture(const char *path, const struct tone *tone, double cosine) {
    guint16 deep[SIDE * SIDE];
    guint8 shallow[SIDE * SIDE];
    g_autoptr(ExrFile) file32 = exr_file_new();
    exr_file_add(file32,
                 exr_part_new("Y", SIDE, SIDE, (const char *const[]){"Y", NULL}, EXR_FLOAT));
    for (int i = 0; i < SIDE * SIDE; i++) {
        const double light = tone->black + tone->scale * (0.3 + 0.4 * (i % 5) / 4) * cosine;
        const double code = tone->srgb ? encode(light) : light;
        deep[i] = (guint16)lround(65535 * code);
        shallow[i] = (guint8)lround(255 * code);
        exr_part_plane(file32->parts->pdata[0], "Y")[i] = (float)light;
    }
    if (tone->bits == 32) {
        g_assert_true(exr_write(path, file32, EXR_NONE, FALSE, NULL));
        return;
    }
    if (tone->bits == 8) {
        png_image image = {
            .version = PNG_IMAGE_VERSION, .width = SIDE, .height = SIDE, .format = PNG_FORMAT_GRAY};
        g_assert_true(png_image_write_to_file(&image, path, 0, shallow, 0, NULL));
        return;
    }
    FILE *file = fopen(path, "wb"); /* png_image would take 16 bits for linear and encode 8 */
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, NULL, NULL, NULL);
    png_infop info = png_create_info_struct(png);
    png_init_io(png, file);
    png_set_IHDR(png, info, SIDE, SIDE, 16, PNG_COLOR_TYPE_GRAY, PNG_INTERLACE_NONE,
                 PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    png_write_info(png, info);
    png_set_swap(png);
    for (int y = 0; y < SIDE; y++)
        png_write_row(png, (png_const_bytep)(deep + y * SIDE));
    png_write_end(png, info);
    png_destroy_write_struct(&png, &info);
    fclose(file);
}

TEST(tones) {
    static const struct tone all[] = {
        {"srgb8", 8, TRUE, 1, 0, NULL},
        {"linear16", 16, FALSE, 1, 0, NULL},
        {"linear8", 8, FALSE, 1, 0, "linear pictures had been taken for sRGB"},
        {"srgb16", 16, TRUE, 1, 0, "sRGB pictures had been taken for linear"},
        {"black16", 16, FALSE, 0.9, 0.06, "a level of 0.06 of white is added to all values"},
        {"taken16", 16, FALSE, 1, -0.06, "0.06 of white was subtracted from all values"},
        {"bright16", 16, FALSE, 1.4, 0, NULL},
        {"bright32", 32, FALSE, 3, 0, "is the white tile darker than --reflectance said"},
        {"short16", 16, FALSE, 0.002, 0, "less than from the blackest paint"},
    };
    static const int angles_deg[] = {0, 30, 50, 70};
    for (gsize k = 0; k < G_N_ELEMENTS(all); k++) {
        g_autofree char *pictures = g_build_filename(folder, all[k].name, NULL);
        g_autofree char *session = g_strconcat(pictures, ".session", NULL);
        g_mkdir(pictures, 0700);
        for (int v = 0; v < 4; v++)
            for (int l = 0; l < 4; l++) {
                g_autofree char *path =
                    g_strdup_printf("%s/tl%03d_pl000_tv%03d_pv000.%s", pictures, angles_deg[l],
                                    angles_deg[v], all[k].bits == 32 ? "exr" : "png");
                write_picture(path, &all[k], cos(angles_deg[l] * G_PI / 180));
            }
        g_free(process_mesorig(0, "import pictures %s -o %s", pictures, session));
        g_autofree char *told = process_mesorig(0, "check %s", session);
        g_test_message("%s: %s", all[k].name, told);
        g_assert_cmpint(strstr(told, "suspect ") != NULL, ==, all[k].says != NULL);
        const char *first = strstr(told, "suspect ");
        g_assert_null(first ? strstr(first + 1, "suspect ") : NULL);
        if (all[k].says)
            assert_has(told, all[k].says);
        g_free(process_mesorig(all[k].says ? 1 : 0, "check %s --strict", session));
    }
}

static void change_session(const char *session, const char *sql) {
    g_autofree char *path = g_build_filename(session, "session.db", NULL);
    sqlite3 *db = NULL;
    g_assert_cmpint(sqlite3_open(path, &db), ==, SQLITE_OK);
    g_assert_cmpint(sqlite3_exec(db, sql, NULL, NULL, NULL), ==, SQLITE_OK);
    sqlite3_close(db);
}

/* A structure that is said to have no depth, below a plane 5 mm too high: little of it is left. */
TEST(depth) {
    g_autofree char *session = g_build_filename(folder, "small.session", NULL);
    g_free(process_mesorig(0,
                           "capture " SOURCE_DIR "/tests/small/rig.conf " SOURCE_DIR
                           "/tests/small/session.conf -o %s",
                           session));
    g_free(process_mesorig(0, "process %s", session));
    g_autofree char *right = process_mesorig(0, "check %s", session);
    g_assert_null(strstr(right, "suspect "));
    change_session(
        session,
        "UPDATE grid SET depth_mm = 0, reference_mm = reference_mm + 5; DELETE FROM product");
    g_free(process_mesorig(0, "process %s", session));
    g_autofree char *wrong = process_mesorig(0, "check %s", session);
    assert_has(wrong, "below depth_mm = 0 are left out");
}

/* A picture for `import pictures` of one value. */
static void write_even_picture(const char *path, double light) {
    g_autoptr(ExrFile) file = exr_file_new();
    exr_file_add(file, exr_part_new("Y", SIDE, SIDE, (const char *const[]){"Y", NULL}, EXR_FLOAT));
    for (int i = 0; i < SIDE * SIDE; i++)
        exr_part_plane(file->parts->pdata[0], "Y")[i] = (float)light;
    g_assert_true(exr_write(path, file, EXR_NONE, FALSE, NULL));
}

/* Lamps that are dead in a session whose import has not seen it, as in a captured one; a lamp that
 * is weak; and a black varnish, which is dark but where it mirrors a lamp. */
TEST(dead_lamps) {
    static const struct {
        const char *name, *says;
        int dead;
        double weak, matt; /* reflectance */
    } all[] = {
        {"alive", NULL, 0, 1, 0.4},
        {"weak", NULL, 0, 0.2, 0.4},
        {"varnish", NULL, 0, 1, 0.004},
        {"dead",
         "6 of 18 lights are near zero in all views (θ φ 30° 0°, 30° 60°, 30° 120°, 30° "
         "180° and 2 more)",
         6, 1, 0.4},
        {"dead-varnish", "1 of 18 lights is near zero in all views (θ φ 30° 0°)", 1, 1, 0.004},
    };
    for (gsize k = 0; k < G_N_ELEMENTS(all); k++) {
        g_autofree char *pictures = g_build_filename(folder, all[k].name, NULL);
        g_autofree char *session = g_strconcat(pictures, ".session", NULL);
        g_mkdir(pictures, 0700);
        for (int v = 0; v < 2; v++)
            for (int l = 0; l < 18; l++) {
                const int theta = 30 + 25 * (l / 6), phi = 60 * (l % 6), view = v * 30;
                g_autofree char *path = g_strdup_printf("%s/tl%03d_pl%03d_tv%03d_pv000.exr",
                                                        pictures, theta, phi, view);
                const double mirror = theta == view && phi == 180 ? 0.5 : 0;
                const double f = l < all[k].dead ? 1e-5 : all[k].matt + mirror;
                write_even_picture(path, f * cos(theta * G_PI / 180) * (l == 17 ? all[k].weak : 1));
            }
        g_free(process_mesorig(0, "import pictures %s -o %s", pictures, session));
        g_autofree char *imported = process_mesorig(0, "check %s", session);
        g_assert_null(strstr(imported, "near zero")); /* the import has said it */
        g_assert_cmpint(strstr(imported, "lights are dark") != NULL, ==, all[k].says != NULL);
        change_session(session, "DELETE FROM value WHERE key = 'suspicions'");
        g_autofree char *told = process_mesorig(0, "check %s", session);
        g_assert_cmpint(strstr(told, "suspect ") != NULL, ==, all[k].says != NULL);
        if (all[k].says)
            assert_has(told, all[k].says);
    }
}

/* A plate of 30 mm on the turntable, below a plane that touches it, and under one that cuts through
 * it. */
TEST(plane_too_low) {
    static const struct change world[] = {{"[sample]", "width_mm = 30"},
                                          {"[sample]", "base_mm = 5"},
                                          {"[world]", "turntable_albedo = 0.5"},
                                          {NULL, NULL}};
    static const struct change conf[] = {
        {"[capture]", "sweep_steps = 60"}, {"[sample]", "texels = 24"}, {NULL, NULL}};
    g_autofree char *directory = g_build_filename(folder, "plate", NULL);
    g_autofree char *session = g_build_filename(directory, "plate.session", NULL);
    g_mkdir(directory, 0700);
    small_rig_write(directory, "rig.conf", NULL);
    small_rig_write(directory, "world.conf", world);
    small_rig_write(directory, "session.conf", conf);
    g_free(process_mesorig(0, "capture %s/rig.conf %s/session.conf -o %s", directory, directory,
                           session));
    g_free(process_mesorig(0, "process %s", session));
    g_autofree char *right = process_mesorig(0, "check %s", session);
    g_assert_null(strstr(right, "suspect "));
    change_session(session, "UPDATE grid SET reference_mm = reference_mm - 3; DELETE FROM product");
    g_free(process_mesorig(0, "process %s", session));
    g_autofree char *wrong = process_mesorig(0, "check %s", session);
    assert_has(wrong, "of the surface above the reference plane at reference_mm = 2,");
    g_free(process_mesorig(1, "check %s --strict", session));
}

BEFORE_TESTS {
    folder = g_dir_make_tmp("mesorig-check-XXXXXX", NULL);
}

AFTER_TESTS {
    remove_tree(folder);
    g_free(folder);
}
