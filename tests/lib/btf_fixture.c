#include "btf_fixture.h"

struct btf_matrix *btf_fixture_of(const char *name, int width, int height,
                                  struct direction_list views, struct direction_list lights) {
    struct btf_matrix *btf = g_new0(struct btf_matrix, 1);
    btf->name = g_strdup(name);
    btf->layout = (struct btf_layout){(gsize)width, (gsize)height, 0.5, 5, views, lights};
    btf->values = g_new0(float, btf_layout_texels(&btf->layout) * btf_layout_values(&btf->layout));
    return btf;
}

struct btf_matrix *btf_fixture_new(const char *name, int width, int height, int n_views,
                                   int n_lights) {
    return btf_fixture_of(name, width, height, btf_fixture_line(n_views, 1, 2),
                          btf_fixture_line(n_lights, 3, 4));
}

struct direction_list btf_fixture_line(int n, float theta_deg, float phi_deg) {
    struct direction_list ret = direction_list_new((gsize)n);
    for (int i = 0; i < n; i++) {
        ret.theta_deg[i] = theta_deg * (float)i;
        ret.phi_deg[i] = phi_deg * (float)i;
    }
    return ret;
}

struct direction_list btf_fixture_rings(int rings, float most_deg, float turn_deg) {
    struct direction_list ret = direction_list_new(1 + 3 * (gsize)rings * ((gsize)rings + 1));
    for (int ring = 1, n = 1; ring <= rings; ring++)
        for (int i = 0; i < 6 * ring; i++, n++) {
            ret.theta_deg[n] = most_deg * (float)ring / (float)rings;
            ret.phi_deg[n] = 360 * (float)i / (float)(6 * ring) + turn_deg;
        }
    return ret;
}

struct direction_list btf_fixture_two_rings(float turn_deg) {
    struct direction_list list = direction_list_new(12);
    for (gsize k = 0; k < list.n; k++) {
        list.theta_deg[k] = k < 6 ? 25 : 55;
        list.phi_deg[k] = (float)(60 * (k % 6)) + turn_deg + (k < 6 ? 0 : 30);
    }
    return list;
}

struct vec3 btf_fixture_direction(const struct direction_list *list, gsize k) {
    return direction_of_deg((double)list->theta_deg[k], (double)list->phi_deg[k]);
}
