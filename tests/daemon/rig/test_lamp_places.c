/* Lamps that the section of their bank places (count, rings, theta_deg, positions), next to the
 * same lamps written by hand, one section each. */
#include "lib/folder.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "lib/text_file.h"
#include "rig/devices.h"
#include "rig/devices_options.h"
#include "rig/lamp_places.h"

#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

#define DOME SOURCE_DIR "/etc/demo/dome/"
#define HEAD "[rig]\nid = r\narc_radius_mm = 500\n\n"
#define BANK "[lamps dome]\ndriver = program-lamps\nprogram = true\n"
#define CAMERA                                                                                     \
    "\n[camera c]\ndriver = v4l2-camera\ndevice = /dev/null\ntheta_deg = 0\nphi_deg = 0\n"         \
    "distance_mm = 650\nwidth = 8\nheight = 8\nfocal_px = 10\n"
#define ARC                                                                                        \
    "\n[axis arc]\ndriver = program-axis\nprogram = true\nmin_deg = -90\nmax_deg = 90\n"           \
    "speed_deg_s = 20\naccel_deg_s2 = 40\n"

BEFORE_TESTS {
    folder_make();
}

AFTER_TESTS {
    folder_remove();
}

/* The rig of a file in the folder of the test. All bytes are set, so that rigs can be compared. */
static struct rig *rig_of(const char *text) {
    struct rig *rig = g_new0(struct rig, 1);
    g_autofree char *path = in_folder("rig.conf");

    text_file_write(folder, "rig.conf", text);
    g_assert_true(ok(devices_read_geometry(path, rig, ERR)));
    return rig;
}

/* Sections [lamp NAME] of the bank dome. */
static void by_hand(GString *to, const char *name, int index, const char *theta, const char *phi,
                    const char *more) {
    g_string_append_printf(to, "\n[lamp %s]\nbank = dome\nindex = %d\ntheta_deg = %s\n%s%s\n%s\n",
                           name, index, theta, phi ? "phi_deg = " : "", phi ? phi : "", more);
}

static void assert_same(const char *keys, const char *more, const char *lamps) {
    g_autofree char *placed = g_strconcat(HEAD BANK, keys, more, CAMERA, NULL);
    g_autofree char *written = g_strconcat(HEAD BANK, lamps, more, CAMERA, NULL);
    g_autofree struct rig *a = rig_of(placed), *b = rig_of(written);

    g_autofree char *text_a = rig_to_text(a), *text_b = rig_to_text(b);
    g_assert_cmpstr(text_a, ==, text_b);
    g_assert_cmpmem(a, sizeof *a, b, sizeof *b);
}

TEST(rings) {
    static const char *const azimuths[] = {"0", "90", "180", "270", "10", "130", "250"};
    g_autoptr(GString) lamps = g_string_new(NULL);

    for (int i = 0; i < 7; i++) {
        const char name[] = {'d', 'o', 'm', 'e', '_', '0', (char)('1' + i), '\0'};
        by_hand(lamps, name, 3 + i, i < 4 ? "15" : "60", azimuths[i],
                "distance_mm = 400\nexponent = 2\nintensity = 25\n");
    }
    assert_same("rings = 15:4; 60 : 3 : 10\ndistance_mm = 400\nexponent = 2\nintensity = 25\n"
                "first_index = 3\n",
                "", lamps->str);
    /* phi_deg turns all of them */
    g_string_truncate(lamps, 0);
    by_hand(lamps, "dome_01", 0, "0", "30", "distance_mm = 400\n");
    by_hand(lamps, "dome_02", 1, "45", "30", "distance_mm = 400\n");
    by_hand(lamps, "dome_03", 2, "45", "210", "distance_mm = 400\n");
    assert_same("rings = 0:1; 45:2\ndistance_mm = 400\nphi_deg = 30\n", "", lamps->str);
}

/* On the axis [axis arc], or at an azimuth. */
TEST(arc) {
    g_autoptr(GString) lamps = g_string_new(NULL);

    by_hand(lamps, "dome_01", 0, "15", NULL, "distance_mm = 500\n");
    by_hand(lamps, "dome_02", 1, "42.5", NULL, "distance_mm = 500\n");
    assert_same("theta_deg = 15; 42.5\ndistance_mm = 500\n", ARC, lamps->str);
    g_string_truncate(lamps, 0);
    by_hand(lamps, "dome_01", 0, "15", "-20", "distance_mm = 500\n");
    by_hand(lamps, "dome_02", 1, "42.5", "-20", "distance_mm = 500\n");
    assert_same("theta_deg = 15; 42.5\nphi_deg = -20\ndistance_mm = 500\n", ARC, lamps->str);
}

/* The axis does not carry rings, a spiral, or lamps of a file. */
TEST(fixed) {
    static const char *const keys[] = {"rings = 30:2\n", "count = 2\n", "positions = two.lp\n"};

    text_file_write(folder, "two.lp", "2\na 0 1 1\nb 1 0 1\n");
    for (gsize i = 0; i < G_N_ELEMENTS(keys); i++) {
        g_autofree char *text =
            g_strconcat(HEAD BANK "distance_mm = 400\n", keys[i], ARC, CAMERA, NULL);
        g_autofree struct rig *rig = rig_of(text);
        g_assert_cmpint(rig->n_lamps, ==, 2);
        g_assert_true(rig->lamps[0].fixed && rig->lamps[1].fixed);
    }
}

/* The dome of the demo stands where its world says, which lists every lamp by its rounded angles.
 */
TEST(demo) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Config) world = ok(config_load(DOME "world.conf", ERR));
    g_autofree struct rig *rig = g_new0(struct rig, 1);

    g_assert_true(ok(devices_read_geometry(DOME "rig.conf", rig, ERR)));
    g_assert_cmpint(rig->n_lamps, ==, 64);
    for (int i = 0; i < 64; i++) {
        const struct rig_lamp *lamp = &rig->lamps[i];
        g_autofree char *name = g_strdup_printf("dome_%02d", i + 1);
        g_assert_cmpstr(lamp->name, ==, name);
        const struct config_section *truth = config_find(world, "lamp", name);
        g_assert_nonnull(truth);
        const double theta = g_ascii_strtod(config_value(truth, "theta_deg", NULL), NULL),
                     phi = g_ascii_strtod(config_value(truth, "phi_deg", NULL), NULL),
                     t = theta * G_PI / 180, p = phi * G_PI / 180;
        const struct vec3 at = {400 * sin(t) * cos(p), 400 * sin(t) * sin(p), 400 * cos(t)};
        /* 0.005° of each angle are 0.035 mm */
        g_assert_cmpfloat(vec3_length(vec3_sub(lamp->position_mm, at)), <, 0.05);
        g_assert_true(lamp->fixed);
        g_assert_cmpfloat(lamp->exponent, ==, 2);
        g_assert_cmpfloat(lamp->intensity, ==, 25);
    }
}

/* Any spiral: within its zone, with equal areas above each lamp, and no two lamps close together.
 * On a zone of area A·r² the lamps of a lattice are about √(A/n) apart. */
TEST(spiral) {
    g_autoptr(GRand) rand = g_rand_new_with_seed(7);

    for (int k = 0; k < 60; k++) {
        const int n = g_rand_int_range(rand, 1, RIG_MAX_LAMPS + 1);
        const int from = g_rand_int_range(rand, 0, 30), to = g_rand_int_range(rand, 50, 90);
        g_autofree char *text =
            g_strdup_printf(HEAD BANK "count = %d\ntheta_from_deg = %d\ntheta_to_deg = %d\n"
                                      "distance_mm = 1\n" CAMERA,
                            n, from, to);
        g_autofree struct rig *rig = rig_of(text);
        const double top = cos(from * G_PI / 180), rim = cos(to * G_PI / 180);
        const double apart = sqrt(2 * G_PI * (top - rim) / n);
        g_assert_cmpint(rig->n_lamps, ==, n);
        for (int i = 0; i < n; i++) {
            const struct vec3 at = rig->lamps[i].position_mm;
            g_assert_cmpfloat(fabs((top - at.z) / (top - rim) * n - (i + 0.5)), <, 1e-9);
            for (int j = 0; j < i; j++)
                g_assert_cmpfloat(vec3_length(vec3_sub(at, rig->lamps[j].position_mm)), >,
                                  0.5 * apart);
        }
        g_assert_cmpstr(rig->lamps[0].name, ==, n > 99 ? "dome_001" : "dome_01");
    }
}

/* 3-4-5 triangles, whose angles and lengths are known. */
TEST(list) {
    g_autoptr(GString) lamps = g_string_new(NULL);
    const double theta = atan2(3, 4) * 180 / G_PI;
    g_autofree char *angle = g_strdup_printf("%.17g", theta);

    by_hand(lamps, "dome_01", 0, angle, "0", "distance_mm = 500\n");
    by_hand(lamps, "dome_02", 1, angle, "90", "distance_mm = 250\n");
    by_hand(lamps, "dome_03", 2, "0", "0", "distance_mm = 300\n");
    text_file_write(folder, "mm.lp",
                    "\xef\xbb\xbf"
                    "# a dome\r\n3\r\nIMG 1.jpg 300 0 400\r\nb.jpg\t0\t150\t200\r\n\r\nc 0 0 3e2");
    assert_same("positions = mm.lp\n", "", lamps->str);
    /* unit vectors, with decimal commas */
    g_string_truncate(lamps, 0);
    by_hand(lamps, "dome_01", 5, angle, "15", "distance_mm = 320\nintensity = 4\n");
    by_hand(lamps, "dome_02", 6, angle, "195", "distance_mm = 320\nintensity = 4\n");
    text_file_write(folder, "unit.lp", "2\na.jpg 0,6 0 0,8\nb.jpg -0.6 0 0.8\n");
    assert_same("positions = unit.lp\ndistance_mm = 320\nphi_deg = 15\nfirst_index = 5\n"
                "intensity = 4\n",
                "", lamps->str);
}

TEST(table) {
    g_autoptr(GString) lamps = g_string_new(NULL);
    g_autofree char *angle = g_strdup_printf("%.17g", atan2(3, 4) * 180 / G_PI);

    by_hand(lamps, "top", 9, angle, "0", "distance_mm = 500\nintensity = 3\n");
    by_hand(lamps, "dome_02", 4, angle, "180", "distance_mm = 250\nintensity = 7.5\n");
    text_file_write(folder, "points.csv",
                    "name;x_mm;y_mm;z_mm;index;intensity\ntop;300;0;400;9;\n;-150;0;200;4;7,5\n");
    assert_same("positions = points.csv\nintensity = 3\n", "", lamps->str);
    g_string_truncate(lamps, 0);
    by_hand(lamps, "dome_01", 0, "12.25", "-90", "distance_mm = 500\nexponent = 2\n");
    by_hand(lamps, "dome_02", 1, "80", "45", "distance_mm = 400\nexponent = 2\n");
    text_file_write(folder, "angles.csv",
                    "theta_deg,phi_deg,distance_mm,exponent\n12.25,-90,,\n80,45,400,2\n");
    assert_same("positions = angles.csv\ndistance_mm = 500\nexponent = 2\n", "", lamps->str);
}

/* Two banks share a table, and each takes its own rows. */
TEST(shared_table) {
    static const char *const names[] = {"dome_01", "dome_02", "x", "b_02"};
    static const double theta_deg[] = {10, 30, 20, 40};

    text_file_write(folder, "shared.csv",
                    "bank,name,theta_deg,phi_deg\ndome,,10,0\nb,x,20,0\ndome,,30,0\nb,,40,0\n");
    g_autofree struct rig *rig =
        rig_of(HEAD BANK "positions = shared.csv\ndistance_mm = 400\n\n[lamps b]\ndriver = "
                         "program-lamps\nprogram = true\npositions = shared.csv\n"
                         "distance_mm = 400\n" CAMERA);
    g_assert_cmpint(rig->n_lamps, ==, 4);
    for (int i = 0; i < 4; i++) {
        g_assert_cmpstr(rig->lamps[i].name, ==, names[i]);
        g_assert_cmpfloat(fabs(rig->lamps[i].position_mm.z - 400 * cos(theta_deg[i] * G_PI / 180)),
                          <, 1e-9);
    }
}

/* Random places, as a list, as a table and by hand. */
TEST(random_files) {
    g_autoptr(GRand) rand = g_rand_new_with_seed(11);

    for (int k = 0; k < 40; k++) {
        const int n = g_rand_int_range(rand, 1, RIG_MAX_LAMPS + 1);
        g_autoptr(GString) list = g_string_new(NULL), table = g_string_new("z_mm,y_mm,x_mm\n");
        g_autofree struct vec3 *at = g_new0(struct vec3, n);
        g_string_printf(list, "%d\n", n);
        for (int i = 0; i < n; i++) {
            at[i] = vec3(g_rand_double_range(rand, -600, 600), g_rand_double_range(rand, -600, 600),
                         g_rand_double_range(rand, 5, 600));
            g_string_append_printf(list, "p%d.jpg %.17g %.17g %.17g\n", i, at[i].x, at[i].y,
                                   at[i].z);
            g_string_append_printf(table, "%.17g,%.17g,%.17g\n", at[i].z, at[i].y, at[i].x);
        }
        text_file_write(folder, "random.lp", list->str);
        text_file_write(folder, "random.csv", table->str);
        g_autofree struct rig *a = rig_of(HEAD BANK "positions = random.lp\n" CAMERA);
        g_autofree struct rig *b = rig_of(HEAD BANK "positions = random.csv\n" CAMERA);
        g_assert_cmpmem(a, sizeof *a, b, sizeof *b);
        g_assert_cmpint(a->n_lamps, ==, n);
        for (int i = 0; i < n; i++) {
            const struct vec3 aim = vec3_scale(at[i], -1 / vec3_length(at[i]));
            g_assert_cmpfloat(vec3_length(vec3_sub(a->lamps[i].position_mm, at[i])), <, 1e-9);
            g_assert_cmpfloat(vec3_length(vec3_sub(a->lamps[i].aim, aim)), <, 1e-12);
        }
    }
}

/* Other lamps before and behind, in sections of their own and in another bank. */
TEST(order) {
    g_autofree struct rig *rig =
        rig_of(HEAD "[lamp first]\nbank = dome\nindex = 2\ntheta_deg = 5\nphi_deg = 0\n"
                    "distance_mm = 300\n\n" BANK "rings = 30:2\ndistance_mm = 400\n\n"
                    "[lamp last]\nbank = b\nindex = 1\ntheta_deg = 5\nphi_deg = 90\n"
                    "distance_mm = 300\n\n[lamps b]\ndriver = program-lamps\nprogram = true\n"
                    "count = 1\ndistance_mm = 100\n" CAMERA);
    static const char *const names[] = {"first", "dome_01", "dome_02", "last", "b_01"};

    g_assert_cmpint(rig->n_lamps, ==, 5);
    for (int i = 0; i < 5; i++)
        g_assert_cmpstr(rig->lamps[i].name, ==, names[i]);
}

struct bad {
    const char *keys;
    int line; /* of the keys, from 1; 0: the heading */
    const char *says;
};

static const struct bad bad_keys[] = {
    {"count = 1025\ndistance_mm = 9\n", 1, "count: 1025 is out of range: 0 to 1024"},
    {"count = 0\ndistance_mm = 9\n", 1, "count: is 0; give 1 to 1024 lamps"},
    {"count = 9\n", 0, "distance_mm: must be given, and must be from 1 to 100000 mm"},
    {"rings = 9:2\ndistance_mm = 0.5\n", 2, "distance_mm: must be given"},
    {"count = 9\ndistance_mm = 9\nrings = 9:2\n", 3, "rings: says where the lamps are, as count"},
    {"count = 9\ndistance_mm = 9\ntheta_from_deg = 80\n", 3,
     "theta_from_deg: is 80, but must be less than theta_to_deg, which is 80"},
    {"rings = 9:2\ndistance_mm = 9\ntheta_to_deg = 80\n", 3, "theta_to_deg: belongs to count"},
    {"intensity = 2\n[lamp d]\nbank = dome\nindex = 1\ntheta_deg = 0\ndistance_mm = 3\n", 1,
     "intensity: belongs to lamps that this section places; give count"},
    {"rings = 15:8, 35:16\ndistance_mm = 9\n", 1, "rings: \"15:8, 35:16\" is not theta:count"},
    {"rings = 15:8; 95:2\ndistance_mm = 9\n", 1, "rings: \"95:2\" is not"},
    {"rings = 15:2.5\ndistance_mm = 9\n", 1, "rings: \"15:2.5\" is not"},
    {"rings = 15:2:400\ndistance_mm = 9\n", 1, "rings: \"15:2:400\" is not"},
    {"rings = 0:2\ndistance_mm = 9\n", 1, "count from 1 to 1024 (1 at theta 0)"},
    {"rings = \ndistance_mm = 9\n", 1, "rings: names no lamp"},
    {"rings = 15:600; 20:600\ndistance_mm = 9\n", 1, "rings: names too many lamps; give 1 to 1024"},
    {"theta_deg = 15; 90\nphi_deg = 0\ndistance_mm = 9\n", 1, "theta_deg: 90 is out of range"},
    {"theta_deg = 15; 30\ndistance_mm = 9\n", 0, "phi_deg: must be given, because there is no"},
    {"radius_mm = 9\ncount = 3\n", 1, "radius_mm"},
    {"positions = none.lp\n", 1, "none.lp"},
    {"count = 3\ndistance_mm = 9\n[lamp dome_02]\nbank = dome\nindex = 3\ntheta_deg = 0\n"
     "distance_mm = 3\n",
     3, "a lamp with the name dome_02 is already in line 5"},
    {"count = 3\ndistance_mm = 9\n[lamp d]\nbank = dome\nindex = 1\ntheta_deg = 0\n"
     "distance_mm = 3\n",
     5, "index: lamp 1 of dome is already used for the lamp dome_02, in line 5"},
};

static char *refused(const char *keys) {
    g_autofree char *text = g_strconcat(HEAD BANK, keys, CAMERA, NULL);
    g_autofree char *path = in_folder("rig.conf");
    g_autofree struct rig *rig = g_new0(struct rig, 1);
    g_autoptr(GError) error = NULL;

    text_file_write(folder, "rig.conf", text);
    g_assert_false(devices_read_geometry(path, rig, &error));
    g_assert_nonnull(error);
    return g_strdup(error->message);
}

TEST(mistakes) {
    g_autofree char *path = in_folder("rig.conf");

    for (gsize i = 0; i < G_N_ELEMENTS(bad_keys); i++) {
        const struct bad *bad = &bad_keys[i];
        g_autofree char *message = refused(bad->keys);
        g_autofree char *where =
            g_strdup_printf("%s:%d: [", path, bad->line == 0 ? 5 : 7 + bad->line);
        g_test_message("%s", message);
        g_assert_true(g_str_has_prefix(message, where));
        g_assert_nonnull(strstr(message, bad->says));
    }
}

struct bad_file {
    const char *name, *text;
    int line; /* 0: the file as a whole */
    const char *says;
};

static const struct bad_file bad_files[] = {
    {"a.lp", "", 1, "the list is empty; begin it with the number of lights"},
    {"a.lp", "a 1 2 300\n", 1, "“a 1 2 300” is not the number of lights, 1 to 1024"},
    {"a.lp", "1025\n", 1, "“1025” is not the number of lights, 1 to 1024"},
    {"a.lp", "2\na 1 2 300\n", 1, "this line states 2 lights, but the file lists 1"},
    {"a.lp", "1\na 1 2 300\nb 1 2 300\n", 1, "states 1 lights, but the file lists 2"},
    {"a.lp", "1\na 1 x 300\n", 2, "“x” is not a number"},
    {"a.lp", "1\n1 2 300\n", 2, "“1” stands where a picture's name and x y z are expected"},
    {"a.lp", "1\na 1 2 -300\n", 2, "1 2 -300 is not above the turntable's top"},
    {"a.lp", "1\na 0 0 0\n", 2, "0 0 0 is not above"},
    {"a.lp", "1\na 0.6 0 0.8\n", 2, "has the length 1; if these are directions, give distance_mm"},
    {"a.lp", "1\na 0 0 1e9\n", 2, "0 0 1e+09 is farther away than 100000 mm"},
    {"a.csv", "x_mm,y_mm\n1,2\n", 0, "must have the columns x_mm, y_mm and z_mm, or theta_deg"},
    {"a.csv", "x_mm,y_mm,z_mm,phi_deg\n1,2,3,4\n", 0, "not columns of both kinds"},
    {"a.csv", "theta_deg,phi_deg\n1,2\n", 0,
     "has no column distance_mm; add it, or give distance_mm in"},
    {"a.csv", "x_mm,y_mm,z_m\n1,2,3\n", 1, "did you mean “z_mm”?"},
    {"a.csv", "x_mm,y_mm,z_mm\n10,20,\n", 2, "z_mm is empty; give x_mm, y_mm and z_mm"},
    {"a.csv", "x_mm,y_mm,z_mm,index\n10,20,3,1.5\n", 2, "index: “1.5” is not a whole number"},
    {"a.csv", "x_mm,y_mm,z_mm,index\n10,20,3,\n", 2, "index: “” is not a whole number"},
    {"a.csv", "x_mm,y_mm,z_mm,intensity\n10,20,3,0\n", 2, "intensity: 0 is out of range"},
    {"a.csv", "theta_deg,phi_deg,distance_mm\n1,2,0\n", 2, "distance_mm: 0 is out of range"},
    {"a.csv", "theta_deg,phi_deg,distance_mm\n,2,9\n", 2, "theta_deg: nan is out of range"},
    {"a.csv", "name,x_mm,y_mm,z_mm\na;b,1,2,3\n", 2, "name: “a;b” is not a name"},
    {"a.csv", "bank,x_mm,y_mm,z_mm\ndome,1,2,3\ndme,1,2,3\n", 3,
     "bank: there is no section [lamps dme]; name an existing one"},
    {"a.csv", "bank,x_mm,y_mm,z_mm\n,1,2,3\n", 2, "bank: is empty; name the bank of the lamp"},
};

TEST(mistakes_in_files) {
    g_autofree char *rig_path = in_folder("rig.conf");

    for (gsize i = 0; i < G_N_ELEMENTS(bad_files); i++) {
        const struct bad_file *bad = &bad_files[i];
        g_autofree char *path = in_folder(bad->name);
        g_autofree char *keys = g_strdup_printf("positions = %s\n", bad->name);
        text_file_write(folder, bad->name, bad->text);
        g_autofree char *message = refused(keys);
        g_autofree char *line = bad->line ? g_strdup_printf(":%d", bad->line) : g_strdup("");
        g_autofree char *where =
            g_strdup_printf("%s:8: [lamps dome] positions: %s%s: ", rig_path, path, line);
        g_test_message("%s", message);
        g_assert_true(g_str_has_prefix(message, where));
        g_assert_nonnull(strstr(message, bad->says));
    }
}

/* A bank with fewer lamps than its section places. */
TEST(too_few) {
    g_autofree char *text = NULL, *path = in_folder("few.conf");
    g_autoptr(GError) error = NULL;

    g_assert_true(g_file_get_contents(DOME "rig.conf", &text, NULL, NULL));
    g_auto(GStrv) count = g_strsplit(text, "count = 64", 2);
    g_autofree char *more = g_strjoinv("count = 66", count);
    g_auto(GStrv) world = g_strsplit(more, "world.conf", -1);
    g_autofree char *moved = g_strjoinv(DOME "world.conf", world);
    text_file_write(folder, "few.conf", moved);
    g_assert_null(devices_open(path, &error));
    g_assert_nonnull(strstr(error->message, "few.conf:9: [lamps dome] count: dome_65 would be lamp "
                                            "64, but dome has the lamps 0 to 63"));
    g_assert_null(strstr(error->message, "dome_66"));
}

/* What a session keeps of the rig file needs no other file. */
TEST(text_of_session) {
    g_autofree char *path = in_folder("kept.conf"), *list = in_folder("kept.lp");
    g_autofree struct rig *rig = g_new0(struct rig, 1);

    text_file_write(folder, "kept.lp", "3\na 100.1 7 300\nb 3 200 100.7\nc -30 -50 0.3\n");
    text_file_write(
        folder, "kept.conf",
        "[rig]\nid = k\nclock = virtual\n[lamps odd]\ndriver = sim-lamps\nworld = " DOME
        "world.conf\nlamps = dome_01; dome_02; dome_03; dome_05\nintensity = 0.1\n# the list\n"
        "positions = kept.lp\n\n[lamp last]\nbank = odd\nindex = 3\ntheta_deg = 9\nphi_deg = 1\n"
        "distance_mm = 2\n[camera cam]\ndriver = sim-camera\nworld = " DOME
        "world.conf\ntheta_deg = 0\nphi_deg = 0\ndistance_mm = 650\nwidth = 192\nheight = 192\n"
        "focal_px = 1664");
    struct devices *devices = ok(devices_open(path, ERR));
    g_assert_cmpint(g_unlink(list), ==, 0);
    g_assert_true(ok(devices_parse_geometry(devices->text, "rig.conf", rig, ERR)));
    g_assert_cmpmem(rig, sizeof *rig, &devices->geometry, sizeof devices->geometry);
    g_assert_cmpint(rig->n_lamps, ==, 4);
    g_assert_cmpstr(rig->lamps[3].name, ==, "last");
    g_assert_nonnull(strstr(devices->text, "# the list\n"));
    g_assert_null(strstr(devices->text, "kept.lp"));
    devices_close(devices);
}

/* A bank's section has the keys of its driver as well. */
TEST(keys_of_drivers) {
    const struct driver_info *info;
    for (gsize i = 0; (info = devices_driver(i)); i++)
        for (const struct option *option = info->options;
             g_str_equal(info->class_name, "lamps") && option->name; option++)
            g_assert_null(options_find(devices_bank_options, option->name));
}
