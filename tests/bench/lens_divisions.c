/*
 * Fits one lens model to random halves of a set of photographs of a board:
 * lens_divisions FOLDER BOARD polynomial|rational|fisheye N SEED > FILE. Instead of N: second,
 * every second photograph in one half, or middle, the first half of the files and the last.
 * docs/lens_peers divisions FILE says whether covariances cover the differences between the halves.
 * Boards are searched once, so that a division takes a second.
 *
 * Four lines a half: division, whether it was fitted, photographs used, number of the lens, width,
 * height; fx … k6; inflation; the covariance.
 */
#include "base/work.h"
#include "cameras/cameras_private.h"
#include "geometry/rig.h"
#include "pictures/picture_read.h"
#include "pictures/vision.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct photograph {
    char *path;
    int width, height;
    GArray *corners; /* struct corner */
};

static int by_path(gconstpointer a, gconstpointer b) {
    return strcmp(((const struct photograph *)a)->path, ((const struct photograph *)b)->path);
}

static GArray *find_boards(const char *folder, const struct board *board) {
    GArray *found = g_array_new(FALSE, TRUE, sizeof(struct photograph));
    g_autoptr(GDir) dir = g_dir_open(folder, 0, NULL);
    for (const char *name; dir && (name = g_dir_read_name(dir));) {
        struct photograph p = {.path = g_build_filename(folder, name, NULL)};
        g_autoptr(Picture) picture = picture_read(p.path, NULL);
        p.corners = picture ? board_find(picture, board, TRUE, NULL) : NULL;
        if (!p.corners) {
            g_free(p.path);
            continue;
        }
        p.width = picture->width;
        p.height = picture->height;
        g_array_append_val(found, p);
    }
    g_array_sort(found, by_path);
    return found;
}

static void fit_half(struct cameras_task *task, const struct photograph *const *half, int n,
                     int division) {
    struct bundle_camera cameras[RIG_MAX_CAMERAS] = {0};
    g_autofree struct bundle_lay *lays = g_new0(struct bundle_lay, n + 1);
    g_autofree struct bundle_stop *stops = g_new0(struct bundle_stop, n + 1);
    g_autofree struct seen *seen = g_new0(struct seen, n + 1);
    struct cameras_work work = {.task = task, .seen = seen, .free_boards = TRUE};
    g_autoptr(GError) error = NULL;
    int used = 0;
    task->n_pictures = n;
    work.nominal.n_cameras = 1;
    work.nominal.cameras[0].rotation = (struct mat3){{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    work.observations = g_array_new(FALSE, TRUE, sizeof(struct bundle_observation));
    work.bundle = (struct bundle){.cameras = cameras,
                                  .lays = lays,
                                  .stops = stops,
                                  .n_cameras = 1,
                                  .n_lays = n,
                                  .n_stops = n};
    for (int i = 0; i < n; i++) {
        stops[i].lay = i;
        seen[i] = (struct seen){.name = half[i]->path,
                                .lay = i,
                                .stop = i,
                                .width = half[i]->width,
                                .height = half[i]->height,
                                .corners = g_array_ref(half[i]->corners)};
    }
    const gboolean ok = cameras_start_lens(&work, &error) && cameras_start_lays(&work, &error) &&
                        cameras_choose_lens(&work, &error) && cameras_refine(&work, &error);
    if (!ok)
        g_printerr("%s\n", error->message);
    for (int i = 0; i < n; i++) {
        used += seen[i].corners != NULL;
        g_clear_pointer(&seen[i].corners, g_array_unref);
        g_clear_pointer(&seen[i].set_aside, g_array_unref);
        g_free(seen[i].why);
    }
    printf("%d %d %d %d %d %d\n", division, ok, used, (int)cameras[0].lens,
           work.nominal.cameras[0].width, work.nominal.cameras[0].height);
    for (int i = 0; i < BUNDLE_INTRINSICS; i++)
        printf("%.15g ", cameras[0].intrinsics[i]);
    printf("\n%g\n", work.inflation[0]);
    for (int i = 0; i < BUNDLE_CAMERA * BUNDLE_CAMERA; i++)
        printf("%.10g ", cameras[0].covariance[i / BUNDLE_CAMERA][i % BUNDLE_CAMERA]);
    printf("\n");
    g_array_unref(work.observations);
}

int main(int argc, char **argv) {
    struct cameras_task task = {.lens_given = TRUE};
    if (argc != 6 || !board_parse(&task.board, argv[2], NULL) ||
        !rig_lens_by_name(argv[3], &task.lens)) {
        g_printerr("usage: %s FOLDER BOARD polynomial|rational|fisheye N SEED\n", argv[0]);
        return 2;
    }
    work_use_one_blas_thread();
    g_autoptr(GArray) found = find_boards(argv[1], &task.board);
    const int n = (int)found->len;
    g_autofree const struct photograph **order = g_new(const struct photograph *, n + 1);
    GRand *rand = g_rand_new_with_seed((guint32)atoi(argv[5]));
    const gboolean second = strcmp(argv[4], "second") == 0;
    const gboolean once = second || strcmp(argv[4], "middle") == 0;
    for (int division = 0; division < (once ? 1 : atoi(argv[4])); division++) {
        for (int i = 0; i < n; i++) {
            const int from = !second ? i : 2 * i < n - n % 2 ? 2 * i + 1 : 2 * (i - n / 2);
            order[i] = &g_array_index(found, struct photograph, from);
        }
        for (int i = n - 1; i > 0 && !once; i--) {
            const int other = g_rand_int_range(rand, 0, i + 1);
            const struct photograph *swapped = order[i];
            order[i] = order[other];
            order[other] = swapped;
        }
        fit_half(&task, order, n / 2, division);
        fit_half(&task, order + n / 2, n - n / 2, division);
    }
    g_rand_free(rand);
    for (int i = 0; i < n; i++) {
        g_free(g_array_index(found, struct photograph, i).path);
        g_array_unref(g_array_index(found, struct photograph, i).corners);
    }
    return 0;
}
