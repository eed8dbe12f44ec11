/* How fast laser frames are absorbed, against copying them. */
#include "bench.h"
#include "frames/sweep.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define WIDTH    1024
#define HEIGHT   768
#define PICTURES 96 /* all different, as those of a sweep are */
#define FRAMES   192
#define REPEATS  5

static double time_copy(guint16 *const *pictures, guint16 *to) {
    double start = bench_now_s();
    for (int t = 0; t < FRAMES; t++) {
        memcpy(to, pictures[t % PICTURES], sizeof(guint16) * WIDTH * HEIGHT);
        __asm__ volatile("" : : "r"(to) : "memory");
    }
    return bench_now_s() - start;
}

static double time_sweep(guint16 *const *pictures) {
    g_autoptr(Sweep) sweep = sweep_new(WIDTH, HEIGHT, FRAMES, 4095);
    double start = bench_now_s();
    for (int t = 0; t < FRAMES; t++)
        sweep_add(sweep, pictures[t % PICTURES]);
    return bench_now_s() - start;
}

int main(int argc, char **argv) {
    gboolean json = FALSE;
    const GOptionEntry entries[] = {
        {"json", 0, 0, G_OPTION_ARG_NONE, &json, "Print one JSON object", NULL}, {NULL}};
    bench_parse(&argc, &argv, entries, NULL);
    guint16 *pictures[PICTURES], *to = g_new0(guint16, WIDTH * HEIGHT);
    GRand *random = g_rand_new_with_seed(1);
    for (int i = 0; i < PICTURES; i++) {
        pictures[i] = g_new(guint16, WIDTH * HEIGHT);
        for (int k = 0; k < WIDTH * HEIGHT; k++) {
            int x = k % WIDTH, line = WIDTH * i / PICTURES;
            pictures[i][k] =
                (guint16)(64 + g_rand_int_range(random, 0, 16) + (abs(x - line) < 8 ? 3000 : 0));
        }
    }
    double copy = G_MAXDOUBLE, sweep = G_MAXDOUBLE;
    for (int i = 0; i < REPEATS; i++) {
        copy = MIN(copy, time_copy(pictures, to));
        sweep = MIN(sweep, time_sweep(pictures));
    }
    double megapixels = 1e-6 * WIDTH * HEIGHT * FRAMES;

    printf(json ? "{\"sweep_mpx_s\": %.0f, \"memcpy_mpx_s\": %.0f, \"ratio\": %.3f}\n"
                : "sweep %.0f Mpx/s, memcpy %.0f Mpx/s, ratio %.3f\n",
           megapixels / sweep, megapixels / copy, copy / sweep);
    for (int i = 0; i < PICTURES; i++)
        g_free(pictures[i]);
    g_free(to);
    g_rand_free(random);
    return 0;
}
