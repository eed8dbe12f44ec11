#include "ball_scene.h"
#include "remove_tree.h"

#include <glib/gstdio.h>
#include <png.h>

void ball_scene_clear(void) {
    g_autofree char *photos = g_build_filename(world_fixture_folder(), "photos", NULL);
    remove_tree(photos);
    g_mkdir(photos, 0700);
}

void ball_scene_write(const char *name, const guint8 *pixels, int width, int height) {
    g_autofree char *path = g_build_filename(world_fixture_folder(), "photos", name, NULL);
    png_image image = {.version = PNG_IMAGE_VERSION,
                       .width = (guint32)width,
                       .height = (guint32)height,
                       .format = PNG_FORMAT_GRAY};
    g_assert_true(png_image_write_to_file(&image, path, 0, pixels, 0, NULL));
}
