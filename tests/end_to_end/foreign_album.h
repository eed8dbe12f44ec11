/*
 * The rig of test_foreign_chain.c, and folders of its pictures: three cameras, four lamps and two
 * lasers that stand still, and a turntable. Failures fail the test. One thread.
 */
#pragma once

#include "lib/foreign_rig.h"

#define DEGREE     (G_PI / 180)
#define CAMERAS    3
#define LAMPS      4
#define LASERS     2
#define STEPS      48    /* of a sweep */
#define FULL_WELL  10000 /* electrons */
#define READ_NOISE 5     /* electrons */

extern const struct pinhole cameras[CAMERAS];
extern const struct arc_lamp lamp; /* where each of them is on its own arc */
extern const double lamp_azimuths_deg[LAMPS];
extern const struct line_laser laser;
extern const double laser_azimuths_deg[LASERS];
/* What the lasers' angles are: zero + (1 + stretch) times what their software says. */
extern const double zero_deg[LASERS], stretch[LASERS];

/* A folder of pictures with its table. */
struct album {
    char *dir;
    GString *rows;
    struct foreign_sensor sensor;
};

struct album album_begin(const char *folder, const char *name);
void album_end(struct album *album); /* writes the table, frees */

/* How pictures under lamps are taken. */
struct look {
    int n_cameras, n_lamps; /* the first ones */
    double exposure_ms;
    int n_spots;    /* samples of a pixel, each way */
    double fine_mm; /* as in struct foreign_shot */
    gboolean grey;
};

/* A picture of each camera under each lamp. */
void album_lamps(struct album *album, const struct foreign_scene *scene, const struct look *look,
                 double turntable_deg);

/* A sweep in grey of each laser for each camera, over ±reach_deg. */
void album_sweeps(struct album *album, const struct foreign_scene *scene, int n_cameras,
                  double turntable_deg, double reach_deg, double fine_mm);
