#include "world_fixture.h"
#include "lib/ok.h"
#include "lib/remove_tree.h"

char *world_fixture_folder(void) {
    static char *folder;
    if (!folder)
        folder = g_dir_make_tmp("mesorig-world-XXXXXX", NULL);
    return folder;
}

char *world_fixture_write(const char *name, const char *text) {
    char *path = g_build_filename(world_fixture_folder(), name, NULL);
    g_assert_true(g_file_set_contents(path, text, -1, NULL));
    return path;
}

World *world_fixture_new(const char *text) {
    g_autofree char *path = world_fixture_write("world.conf", text);
    World *world = ok(world_get(path, ERR));
    return world;
}

void world_fixture_clean(void) {
    remove_tree(world_fixture_folder());
    g_free(world_fixture_folder());
}

void world_fixture_box(GString *obj, int n, double x0, double x1, double y0, double y1, double z) {
    for (int i = 0; i < 8; i++)
        g_string_append_printf(obj, "v %.6f %.6f %.6f\n", i & 1 ? x1 : x0, i & 2 ? y1 : y0,
                               i & 4 ? z : 0.0);
    const int faces[5][4] = {{5, 6, 8, 7}, {1, 2, 6, 5}, {4, 3, 7, 8}, {2, 4, 8, 6}, {3, 1, 5, 7}};
    for (int i = 0; i < 5; i++)
        g_string_append_printf(obj, "f %d %d %d %d\n", n + faces[i][0], n + faces[i][1],
                               n + faces[i][2], n + faces[i][3]);
}
