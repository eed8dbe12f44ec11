/* Chooses a video's frames for the calibration of a lens. */
#include "calibrate_video.h"

#include "cameras/board_find.h"
#include "cameras/board_size.h"
#include "exr/exr.h"
#include "pictures/vision.h"

#include <math.h>

/* Maximum number of frames that are searched for the board. Each of them is sharper than its
 * neighbours. */
#define MAX_KEPT   64
#define MAX_CHOSEN 30
/* Two boards count as one place if they are less than this part of the picture's width apart. */
#define DOUBLED 0.03
/* A corner that is farther than this from its place by the homography does not count. */
#define WITHIN_PX 3

struct telling {
    const struct work *work;
    gint64 begun_us;
};

static gboolean progress(int done, int n, gpointer data, GError **error) {
    const struct telling *t = data;
    return work_tell(t->work, "video", done, n, t->begun_us, error);
}

/* Computes where the four outer corners of the board are in a frame: x and y in pixels. corners has
 * the corners that were found, or is NULL if the board was not seen. Returns the number of corners.
 * Returns 0 if there are fewer than 4, or if they fit no homography. */
static guint board_place(const struct board *board, const GArray *corners, double ret[8]) {
    const int n = corners ? (int)corners->len : 0;
    double size[2], h[9];
    if (n < 4)
        return 0;
    g_autofree double *on = g_new(double, 2 * n), *seen = g_new(double, 2 * n);
    g_autofree guint8 *good = g_new(guint8, n);
    for (int i = 0; i < n; i++) {
        const struct corner *corner = &g_array_index(corners, struct corner, i);
        board_corner_mm(board, corner->id, on + 2 * i);
        seen[2 * i] = corner->x_px;
        seen[2 * i + 1] = corner->y_px;
    }
    if (!vision_homography(on, seen, n, WITHIN_PX, h, good))
        return 0;
    board_size_mm(board, size);
    for (int i = 0; i < 4; i++) {
        const double x = (i & 1 ? 0.5 : -0.5) * size[0], y = (i & 2 ? 0.5 : -0.5) * size[1];
        const double w = h[6] * x + h[7] * y + h[8];
        ret[2 * i] = (h[0] * x + h[1] * y + h[2]) / w;
        ret[2 * i + 1] = (h[3] * x + h[4] * y + h[5]) / w;
    }
    return (guint)n;
}

/* Returns the RMS distance between the outer corners of the board in two frames, in pixels. A board
 * that looks the same upside down may be found either way round. The distance is therefore computed
 * for both ways, and the smaller one is returned. */
static double places_apart(const double a[8], const double b[8]) {
    double sum[2] = {0, 0};
    for (int turned = 0; turned < 2; turned++)
        for (int i = 0; i < 4; i++) {
            const int k = turned ? 3 - i : i;
            const double dx = a[2 * i] - b[2 * k], dy = a[2 * i + 1] - b[2 * k + 1];
            sum[turned] += dx * dx + dy * dy;
        }
    return sqrt(MIN(sum[0], sum[1]) / 4);
}

static int by_frame(gconstpointer a, gconstpointer b) {
    return *(const guint *)a < *(const guint *)b ? -1 : 1;
}

static double sharpness(const struct calibrate_video *video, guint i) {
    return g_array_index(video->video->frames, struct video_frame, i).sharpness;
}

/* Returns the sharpest of the frames that show the board at the same place as frame `at`, which
 * means within `least` pixels of it. A frame whose board is within `least` pixels of that in a
 * chosen frame is not considered. */
static guint sharpest_beside(const struct calibrate_video *video, const double *places,
                             const double *apart, guint at, double least) {
    guint best = at;
    for (guint i = 0; i < video->video->frames->len; i++)
        if (apart[i] > least && sharpness(video, i) > sharpness(video, best) &&
            places_apart(places + 8 * at, places + 8 * i) <= least)
            best = i;
    return best;
}

/* Chooses frames one by one. The first is the frame with the most corners. Each further one is the
 * frame whose board is farthest from the boards of all chosen frames. For each kept frame, places
 * has the 8 numbers of board_place(), and corners has the number of corners that were found. */
static void choose(struct calibrate_video *video, const double *places, const guint *corners) {
    const guint n = video->video->frames->len;
    const double least = DOUBLED * video->video->width;
    g_autofree double *apart = g_new(double, n);
    guint next = 0;
    for (guint i = 0; i < n; i++) {
        apart[i] = corners[i] > 0 ? INFINITY : 0;
        next = corners[i] > corners[next] ? i : next;
    }
    while (apart[next] > least && video->chosen->len < MAX_CHOSEN) {
        const guint chosen = sharpest_beside(video, places, apart, next, least);
        g_array_append_val(video->chosen, chosen);
        for (guint i = 0; i < n; i++) {
            if (corners[i] > 0)
                apart[i] = MIN(apart[i], places_apart(places + 8 * chosen, places + 8 * i));
            next = apart[i] > apart[next] ? i : next;
        }
    }
    g_array_sort(video->chosen, by_frame);
}

/* Returns the name "PATH#FRAME" of a frame. `kept` is the index of the frame in video->frames. */
static char *frame_name(const struct calibrate_video *video, guint kept) {
    return g_strdup_printf("%s#%d", video->path,
                           g_array_index(video->video->frames, struct video_frame, kept).index);
}

struct calibrate_video *calibrate_video_read(const char *path, const struct board *board,
                                             const struct work *work, GError **error) {
    struct telling telling = {work, g_get_monotonic_time()};
    g_autoptr(CalibrateVideo) video = g_new0(struct calibrate_video, 1);
    video->path = g_strdup(path);
    video->chosen = g_array_new(FALSE, FALSE, sizeof(guint));
    video->video = video_read(path, MAX_KEPT, progress, &telling, error);
    if (!video->video || !(video->checksum = exr_sha256(path, NULL, error)))
        return NULL;
    const guint n = video->video->frames->len;
    g_autofree double *places = g_new0(double, 8 * n + 1);
    g_autofree guint *corners = g_new0(guint, n + 1);
    g_autoptr(BoardCensus) census = board_census_new(board);
    gboolean more = TRUE;
    telling.begun_us = g_get_monotonic_time();
    for (guint i = 0; i < n; i++) {
        g_autofree char *name = frame_name(video, i);
        g_autoptr(Picture) picture = video_picture(video->video, i, name, video->checksum);
        if (more && !board_census_before(census, picture, &more, error))
            return NULL;
        g_autoptr(GArray) found = board_find(picture, board, TRUE, NULL);
        if (!board_census_after(census, picture, found, error))
            return NULL;
        corners[i] = board_place(board, found, places + 8 * i);
        video->n_seen += corners[i] > 0;
        if (!work_tell(work, "frames", (int)i + 1, (int)n, telling.begun_us, error))
            return NULL;
    }
    if (video->n_seen == 0) {
        g_set_error(error, PICTURE_FILE_ERROR, PICTURE_FILE_ERROR_FAILED,
                    "%s: the board is in none of the %u sharpest of its %d frames: check that "
                    "--board describes the board in the video",
                    path, n, video->video->n_frames);
        return NULL;
    }
    choose(video, places, corners);
    return g_steal_pointer(&video);
}

void calibrate_video_free(struct calibrate_video *video) {
    if (!video)
        return;
    video_free(video->video);
    g_free(video->path);
    g_free(video->checksum);
    g_array_unref(video->chosen);
    g_free(video);
}

char *calibrate_video_name(const struct calibrate_video *video, guint i) {
    return frame_name(video, g_array_index(video->chosen, guint, i));
}

struct picture *calibrate_video_picture(const struct calibrate_video *video, guint i) {
    g_autofree char *name = calibrate_video_name(video, i);
    return video_picture(video->video, g_array_index(video->chosen, guint, i), name,
                         video->checksum);
}
