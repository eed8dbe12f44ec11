/* Compiled with -DMATERIAL_THREADS_MAIN, this file is the program “material_threads MDF MATERIAL…”
 * for ThreadSanitizer. ThreadSanitizer needs a library that is compiled with it as a whole, and
 * does not know the threads of GLib. */
#include "material_threads.h"

#include <mesorig/material.h>
#include <pthread.h>
#include <stdio.h>
#include <string.h>

#define POINTS  600
#define THREADS 16

struct asked {
    float uv[2], view[3], light[3], footprint, random[2];
};

struct answer {
    float rgb[3];
    struct mesorig_hit hit;
    float drawn[3], drawn_pdf, pdf;
};

struct asker {
    const mesorig_material *material;
    const struct asked *asked;
    int step; /* step through the points; it has no divisor in common with their number */
    struct answer answers[POINTS];
};

static struct asked points[POINTS];
static struct asker askers[THREADS], alone;

/* Returns a number in [0, 1). The sequence is the same in each run. */
static float material_threads_random(unsigned *state) {
    *state = *state * 1664525u + 1013904223u;
    return (float)(*state >> 8) / (float)(1 << 24);
}

static void material_threads_make(void) {
    unsigned state = 5;
    for (int k = 0; k < POINTS; k++) {
        struct asked *p = &points[k];
        for (int i = 0; i < 2; i++) {
            p->uv[i] = 3 * material_threads_random(&state) - 1;
            p->random[i] = material_threads_random(&state);
            p->view[i] = 2 * material_threads_random(&state) - 1;
            p->light[i] = 2 * material_threads_random(&state) - 1;
        }
        p->view[2] = material_threads_random(&state) + 0.05f;
        p->light[2] = material_threads_random(&state) + 0.05f;
        p->footprint = k % 3 == 0 ? material_threads_random(&state) : 0;
    }
}

static void *material_threads_run(void *data) {
    struct asker *asker = data;
    const mesorig_material *m = asker->material;
    for (int k = 0; k < POINTS; k++) {
        const int one = (int)((long)k * asker->step % POINTS);
        const struct asked *p = &asker->asked[one];
        struct answer *a = &asker->answers[one];
        mesorig_material_evaluate(m, 1, p->uv, p->view, p->light, &p->footprint, a->rgb);
        mesorig_material_intersect(m, 1, p->uv, p->view, &a->hit);
        mesorig_material_sample(m, 1, p->uv, p->view, &p->footprint, p->random, a->drawn,
                                &a->drawn_pdf);
        mesorig_material_pdf(m, 1, p->uv, p->view, p->light, &p->footprint, &a->pdf);
    }
    return NULL;
}

static void material_threads_begin(struct asker *asker, const mesorig_material *m, int step) {
    memset(asker, 0, sizeof *asker);
    asker->material = m;
    asker->asked = points;
    asker->step = step;
}

static int material_threads_agree(const struct answer *a, const struct answer *b) {
    int same = a->hit.hit == b->hit.hit && a->hit.distance_mm == b->hit.distance_mm &&
               a->drawn_pdf == b->drawn_pdf && a->pdf == b->pdf;
    for (int i = 0; i < 3; i++)
        same = same && a->rgb[i] == b->rgb[i] && a->drawn[i] == b->drawn[i] &&
               a->hit.normal[i] == b->hit.normal[i];
    return same;
}

const char *material_threads_ask(const char *path, const char *mdf, int n) {
    static const int steps[THREADS] = {1,  7,  11, 13, 17, 19, 23, 29,
                                       31, 37, 41, 43, 47, 53, 59, 61};
    static struct mesorig_error error;
    pthread_t threads[THREADS];
    const char *wrong = NULL;
    int begun = 0;
    mesorig_material *m = mesorig_material_open(path, mdf, &error);
    if (m == NULL)
        return error.text;
    material_threads_make();
    for (int k = 0; k < n && k < THREADS; k++)
        material_threads_begin(&askers[k], m, steps[k]);
    for (; begun < n && begun < THREADS && wrong == NULL; begun++)
        if (pthread_create(&threads[begun], NULL, material_threads_run, &askers[begun]) != 0) {
            wrong = "a thread does not begin";
            break;
        }
    for (int k = 0; k < begun; k++)
        pthread_join(threads[k], NULL);
    material_threads_begin(&alone, m, 1);
    material_threads_run(&alone);
    for (int k = 0; k < begun && wrong == NULL; k++)
        for (int i = 0; i < POINTS && wrong == NULL; i++)
            if (!material_threads_agree(&alone.answers[i], &askers[k].answers[i]))
                wrong = "a thread's answers differ from those of one thread alone";
    mesorig_material_close(m);
    return wrong;
}

#ifdef MATERIAL_THREADS_MAIN
int main(int argc, char **argv) {
    for (int k = 2; k < argc; k++) {
        const char *wrong = material_threads_ask(argv[k], argv[1], 4);
        printf("%s: %s\n", argv[k], wrong != NULL ? wrong : "4 threads agree");
        if (wrong != NULL)
            return 1;
    }
    return argc < 3;
}
#endif
