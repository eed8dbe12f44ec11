/*
 * What the processes of one simulated run share: the simulated disk, and what a life of the daemon
 * reports. It is memory shared with the forked lives, so that it outlives those that are killed.
 */
#pragma once

#include "disk.h"

#define SCENE_MAX_EXPOSURES 4096

enum life_end {
    LIFE_KILLED,  /* it did not come to report an end */
    LIFE_REFUSED, /* the session was not begun or resumed; the message says why */
    LIFE_PAUSED,  /* and was not continued; the message is the reason */
    LIFE_ABORTED,
    LIFE_DONE,
    LIFE_PROCESSED,
    LIFE_FAILED, /* processing; the message says why */
};

/* What a camera of the simulated world truly saw. */
struct exposure {
    guint64 tag; /* shot << 16 | sub */
    int camera;
    double turntable_deg, arc_deg;
    guint32 lamps, lasers; /* bit: it shines */
};

struct scene {
    char folder[256];  /* with rig.conf, world.conf and session.conf */
    char session[300]; /* on the simulated disk, which is the folder "disk" of it */
    enum life_end end;
    gboolean begun; /* the session was made or opened */
    int shots_done; /* as the capture reported last */
    char message[2048];
    char violation[2048]; /* the invariant that a life has seen broken, and how; empty: none */
    int asks, answers;    /* pipes: a life asks for a second daemon, and waits until it has ended */
    int bus_calls;        /* in a life on the bus: how many calls clients sent */
    gint n_exposures;     /* atomic */
    struct exposure exposures[SCENE_MAX_EXPOSURES];
    struct disk disk;
};

struct scene *scene_new(void);
void scene_free(struct scene *scene);

/* Notes that an invariant is broken; the first one counts. */
void scene_break(struct scene *scene, const char *invariant, const char *format, ...)
    G_GNUC_PRINTF(3, 4);
