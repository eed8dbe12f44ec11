#include "demo_part.h"
#include "ok.h"
#include "process.h"

#include <string.h>

#define DEMO SOURCE_DIR "/etc/demo/"

/* Reads a file of the demo without the devices that are not at 30° or 60°. */
static GKeyFile *read_part(const char *name) {
    static const char *const sections[] = {"camera cam%d", "lamp lamp%d", "laser laser%d",
                                           "axis sweep%d"};
    static const int others[] = {15, 45, 75};
    GKeyFile *file = g_key_file_new();
    g_autofree char *from = g_build_filename(DEMO, name, NULL);
    ok(g_key_file_load_from_file(file, from, G_KEY_FILE_NONE, ERR));
    for (gsize s = 0; s < G_N_ELEMENTS(sections); s++)
        for (gsize i = 0; i < G_N_ELEMENTS(others); i++) {
            g_auto(GStrv) parts = g_strsplit(sections[s], "%d", 2);
            g_autofree char *group = g_strdup_printf("%s%d", parts[0], others[i]);
            g_key_file_remove_group(file, group, NULL);
        }
    if (g_key_file_has_group(file, "rig")) {
        g_key_file_set_value(file, "lamp lamp30", "index", "0");
        g_key_file_set_value(file, "lamp lamp60", "index", "1");
    } else {
        g_key_file_set_value(file, "world", "gather_rays", "0");
    }
    return file;
}

void demo_part_write(const char *folder) {
    static const char *const names[] = {"rig.conf", "world.conf"};
    for (gsize i = 0; i < G_N_ELEMENTS(names); i++) {
        g_autoptr(GKeyFile) file = read_part(names[i]);
        g_autofree char *to = g_build_filename(folder, names[i], NULL);
        ok(g_key_file_save_to_file(file, to, ERR));
    }
}

void demo_part_write_session(const char *folder, const char *name, const char *sample,
                             const char *views, const char *lights, const char *lasers,
                             const char *capture) {
    g_autofree char *path = g_build_filename(folder, name, NULL);
    g_autofree char *lights_text =
        lights ? g_strdup_printf("[lights]\nrings=%s\noffset_deg=40\n", lights) : g_strdup("");
    g_autofree char *lasers_text =
        lasers ? g_strdup_printf("[lasers]\nrings=%s\noffset_deg=20\n", lasers) : g_strdup("");
    g_autofree char *text = g_strdup_printf("[session]\nname=%s\n[sample]\n%s\n[views]\nrings=%s\n"
                                            "%s%s[capture]\non_blocked=skip\n%s\n",
                                            name, sample, views, lights_text, lasers_text, capture);
    g_assert_true(g_file_set_contents(path, text, -1, NULL));
}

/* Draws the board. One pixel is one cell of its markers. */
static void draw_board(const char *path) {
    if (g_file_test(path, G_FILE_TEST_EXISTS))
        return;
    const char *const argv[] = {
        BUILD_DIR "/bin/mesorig", "board", path, "--board", DEMO_PART_BOARD, "--pixels",
        "0.8888888888888888",     NULL};
    g_free(process_text(0, argv));
}

void demo_part_lay(const char *folder, enum demo_target target, double height_mm) {
    static const char *const samples[] = {
        [DEMO_BOARD_FLAT] = "kind=plate\nwidth_mm=72\nheight_mm=72\nbase_mm=3\ntop_mm=200\n"
                            "albedo_path=board.png\nturn_deg=3\noffset_mm=1;-2\n",
        [DEMO_BOARD_LEANING] = "kind=plate\nwidth_mm=72\nheight_mm=72\nbase_mm=3\ntop_mm=200\n"
                               "albedo_path=board.png\ntilt_deg=15\ntilt_towards_deg=100\n"
                               "turn_deg=63\noffset_mm=1;0\n",
        [DEMO_POLES] = "kind=poles\nwidth_mm=84\nheight_mm=84\nbase_mm=2\ntop_mm=40\nradius_mm=1\n"
                       "places_mm=-21.4;-19.6;24;20.5;-23.5;12;24.4;18.7;24;-18.1;24.5;12;0.3;8.4;"
                       "20;-5.7;-13.5;5;12.4;2.6;5;-15.7;4.1;5\n",
        [DEMO_PLATE] = "kind=flat\nwidth_mm=60\nheight_mm=60\ntop_mm=10\nalbedo=0.5\n",
        [DEMO_TILE] = "kind=flat\nwidth_mm=60\nheight_mm=60\nbase_mm=2.2\nalbedo=0.96\n",
    };
    g_autoptr(GKeyFile) world = read_part("world.conf");
    g_autofree char *to = g_build_filename(folder, "world.conf", NULL);
    g_auto(GStrv) groups = g_key_file_get_groups(world, NULL);
    /* Marks lie next to the tile only, because the other targets would cover them. */
    for (int i = 0; groups[i]; i++)
        if (strcmp(groups[i], "sample") == 0 ||
            (target != DEMO_TILE && g_str_has_prefix(groups[i], "mark")))
            g_key_file_remove_group(world, groups[i], NULL);
    if (target == DEMO_BOARD_FLAT || target == DEMO_BOARD_LEANING) {
        g_autofree char *board = g_build_filename(folder, "board.png", NULL);
        draw_board(board);
    }
    g_auto(GStrv) lines = g_strsplit(samples[target], "\n", -1);
    for (int i = 0; *lines[i]; i++) {
        g_auto(GStrv) parts = g_strsplit(lines[i], "=", 2);
        g_key_file_set_value(world, "sample", parts[0], parts[1]);
    }
    if (target == DEMO_PLATE)
        g_key_file_set_double(world, "sample", "base_mm", height_mm);
    ok(g_key_file_save_to_file(world, to, ERR));
}

void demo_part_write_targets(const char *folder) {
    demo_part_write_session(folder, "board.conf",
                            "width_mm=72\nheight_mm=72\ntexels=8\nreference_mm=3\ndepth_mm=3",
                            "30:6; 60:6", "30:1", NULL, "exposures_us=8000");
    demo_part_write_session(folder, "lights.conf",
                            "width_mm=60\nheight_mm=60\ntexels=8\nreference_mm=20\ndepth_mm=20",
                            "30:4; 60:4", "30:2; 60:2", NULL, "exposures_us=2000;8000");
    demo_part_write_session(folder, "tile.conf",
                            "width_mm=60\nheight_mm=60\ntexels=8\nreference_mm=2.2\ndepth_mm=2.2",
                            "30:2; 60:2", "30:2; 60:2", NULL,
                            "exposures_us=1000;1000;3000;3000;7000;7000\nkeep_exposures=yes");
}

void demo_part_write_plate(const char *folder, const char *name, int height_mm) {
    g_autofree char *sample =
        g_strdup_printf("width_mm=60\nheight_mm=60\ntexels=8\nreference_mm = %d\ndepth_mm = %d",
                        height_mm, height_mm);
    demo_part_write_session(folder, name, sample, "30:1; 60:1", NULL, "30:3; 60:3",
                            "sweep_steps=64\nlaser_threshold_dn=12\nexposures_us=8000");
}
