#include "brdf.h"

#include "merl.h"
#include "rgl.h"
#include "utia.h"

#include <math.h>

struct Brdf {
    enum brdf_kind kind;
    struct rgl *rgl;
    struct merl *merl;
    struct utia *utia;
};

Brdf *brdf_open(const char *path, enum brdf_kind kind, const struct brdf_coding *coding,
                GError **error) {
    g_autoptr(Brdf) brdf = g_new0(struct Brdf, 1);
    gboolean ok = FALSE;
    brdf->kind = kind;
    switch (kind) {
    case BRDF_RGL:
        ok = (brdf->rgl = rgl_read(path, error)) != NULL;
        break;
    case BRDF_MERL:
        ok = (brdf->merl = merl_read(path, error)) != NULL;
        break;
    case BRDF_UTIA:
        ok = (brdf->utia = utia_read(path, coding, error)) != NULL;
        break;
    }
    return ok ? g_steal_pointer(&brdf) : NULL;
}

void brdf_free(Brdf *brdf) {
    if (!brdf)
        return;
    rgl_free(brdf->rgl);
    merl_free(brdf->merl);
    utia_free(brdf->utia);
    g_free(brdf);
}

void brdf_evaluate(const float light[3], const float view[3], float ret[3], gpointer data) {
    const Brdf *brdf = data;
    ret[0] = ret[1] = ret[2] = 0;
    if (light[2] <= 0 || view[2] <= 0)
        return;
    switch (brdf->kind) {
    case BRDF_RGL:
        rgl_evaluate(brdf->rgl, light, view, ret);
        break;
    case BRDF_MERL:
        merl_evaluate(brdf->merl, light, view, ret);
        break;
    case BRDF_UTIA:
        utia_evaluate(brdf->utia, light, view, ret);
        break;
    }
    for (int c = 0; c < 3; c++)
        ret[c] = isfinite(ret[c]) ? MAX(ret[c], 0) : 0;
}
