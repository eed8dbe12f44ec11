#include "capturing_fixture.h"

double capturing_theta_deg(int view) {
    const int ring = 1 + view / N_PHI;
    return 85.0 / N_RINGS * ring;
}

double capturing_phi_deg(int view) {
    const int k = view % N_PHI;
    return 360.0 / N_PHI * k;
}

char *capturing_session_new(const char *folder) {
    g_autoptr(GError) error = NULL;
    static const struct session_texts texts = {
        .rig_conf = "", .session_conf = "", .calibration = ""};
    struct session_direction views[N] = {0};
    for (int k = 0; k < N; k++) {
        views[k].index = k;
        views[k].theta_deg = capturing_theta_deg(k);
        views[k].phi_deg = capturing_phi_deg(k);
    }
    const struct session_plan plan = {.grid = {W, H, 50, 50, 5, 5}, .views = views, .n_views = N};
    char *path = g_build_filename(folder, "a.session", NULL);
    g_autoptr(Session) session = session_create(path, "a", &texts, &plan, &error);
    g_assert_no_error(error);
    g_autofree char *btf = g_build_filename(path, "products", "btf", NULL);
    g_assert_cmpint(g_mkdir_with_parents(btf, 0755), ==, 0);
    return path;
}

void capturing_move_view(const char *from, const char *session, int view) {
    g_autofree char *name = g_strdup_printf("view_%04d.exr", view);
    g_autofree char *old = g_build_filename(from, name, NULL);
    g_autofree char *new = g_build_filename(session, "products", "btf", name, NULL);
    g_assert_cmpint(g_rename(old, new), ==, 0);
}
