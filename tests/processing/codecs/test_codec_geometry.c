/* The geometry of a session for codecs. The positions are those of near_field_fixture.c. */
#include "codecs/codec/held_out.h"
#include "lib/btf_fixture.h"
#include "lib/mdf_file.h"
#include "lib/near_field_fixture.h"
#include "lib/ok.h"
#include "lib/test.h"

#define SEEN 3 /* the view of the BTF that has distances */

static struct rings views, lights;

/* Writes an MDF of two views, of which the BTF has the first. Each texel but the first of a view is
 * 2 mm behind the reference plane, along its ray. */
static void write_mdf(const char *session) {
    g_autofree char *path = g_build_filename(session, "products", "mdf.exr", NULL);
    g_autoptr(ExrFile) file = exr_file_new();
    for (int k = 0; k < 2; k++) {
        double camera[3];
        near_field_camera_at(&views, SEEN, camera);
        struct exr_part *part =
            mdf_file_add_view(file, k, SIDE, SIDE, k ? 5 : (double)views.theta[SEEN],
                              k ? 7 : (double)views.phi[SEEN], SIDE_MM / SIDE);
        exr_set_double(part, "reference_mm", LEVEL_MM);
        if (k == 0)
            exr_set_v3d(part, "view.centre_mm", camera[0], camera[1], camera[2]);
        for (int texel = 0; texel < ALL; texel++)
            part->planes[0][texel] = texel > 0 ? 2 : -1;
    }
    g_assert_true(ok(exr_write(path, file, EXR_ZIP, FALSE, ERR)));
}

static void assert_points(const struct codec_geometry *geometry) {
    double camera[3];
    near_field_camera_at(&views, SEEN, camera);
    g_assert_cmpuint(geometry->n_points, ==, 2 * (ALL - 1));
    for (int texel = 1; texel < ALL; texel++) {
        const struct codec_surface_point *point = &geometry->points[texel - 1];
        double centre[3], ray[3];
        near_field_texel_centre(texel, centre);
        near_field_towards(camera, centre, ray);
        g_assert_cmpint(point->view, ==, SEEN);
        g_assert_cmpfloat_with_epsilon(point->x, centre[0] - 2 * ray[0], 1e-4);
        g_assert_cmpfloat_with_epsilon(point->y, centre[1] - 2 * ray[1], 1e-4);
        g_assert_cmpfloat_with_epsilon(point->z, -2 * ray[2], 1e-4);
        g_assert_cmpint(point[ALL - 1].view, ==, -1);
    }
}

TEST(read) {
    const struct wish wish = {.width = 40};
    g_autofree char *session = near_field_make_session("near", &views, &lights, &wish);
    g_autoptr(BtfMatrix) btf = ok(btf_matrix_read(session, NULL, ERR));
    write_mdf(session);
    g_autoptr(CodecGeometry) geometry = ok(codec_geometry_read(btf, ERR));
    g_assert_cmpint(geometry->n_views, ==, views.n);
    g_assert_cmpint(geometry->n_lights, ==, lights.n);
    assert_points(geometry);
    for (int v = 0; v < views.n; v++) {
        double at[3], centre[3], expected[3];
        float found[3];
        near_field_camera_at(&views, v, at);
        near_field_texel_centre(6, centre);
        near_field_towards(at, centre, expected);
        codec_geometry_towards(&btf->layout, geometry->camera_mm, &btf->layout.views, v, 6, found);
        for (int k = 0; k < 3; k++) {
            g_assert_cmpfloat_with_epsilon(geometry->camera_mm[3 * v + k], at[k], 1e-3);
            g_assert_cmpfloat_with_epsilon(found[k], expected[k], 1e-5);
        }
        codec_geometry_towards(&btf->layout, NULL, &btf->layout.views, v, 6, found);
        near_field_direction((double)views.theta[v], (double)views.phi[v], expected);
        for (int k = 0; k < 3; k++)
            g_assert_cmpfloat_with_epsilon(found[k], expected[k], 1e-5);
    }
    for (int k = 0; k < 3; k++) { /* lamp 1, mean over the views */
        double mean = 0, at[3];
        for (int v = 0; v < views.n; v++) {
            near_field_lamp_at(&lights, v, 1, at);
            mean += at[k] / views.n;
        }
        g_assert_cmpfloat_with_epsilon(geometry->lamp_mm[3 + k], mean, 1e-3);
    }
}

TEST(rest) {
    const struct wish wish = {.width = 40};
    g_autofree char *session = near_field_make_session("rest", &views, &lights, &wish);
    g_autoptr(BtfMatrix) btf = ok(btf_matrix_read(session, NULL, ERR));
    write_mdf(session);
    g_autoptr(CodecGeometry) geometry = ok(codec_geometry_read(btf, ERR));
    int held_views[] = {1, SEEN}, held_lights[] = {0}, other[] = {1};
    g_autoptr(CodecGeometry) rest =
        held_out_rest_geometry(geometry, &(struct held_out){2, 1, held_views, held_lights, NULL});
    g_autoptr(CodecGeometry) seen =
        held_out_rest_geometry(geometry, &(struct held_out){1, 0, other, NULL, NULL});
    g_assert_cmpint(rest->n_views, ==, views.n - 2);
    g_assert_cmpint(rest->n_lights, ==, lights.n - 1);
    g_assert_cmpuint(rest->n_points, ==, ALL - 1); /* of the view that the BTF lacks */
    g_assert_cmpint(rest->points[0].view, ==, -1);
    g_assert_true(rest->camera_mm[3 * 1] == geometry->camera_mm[3 * 2]);
    g_assert_true(rest->camera_mm[3 * 2] == geometry->camera_mm[3 * 4]);
    g_assert_true(rest->lamp_mm[1] == geometry->lamp_mm[3 + 1]);
    g_assert_cmpuint(seen->n_points, ==, geometry->n_points);
    g_assert_cmpint(seen->points[0].view, ==, SEEN - 1);
}

/* A codec whose value is the view in R, G and B, moved to 0 … 1. */
static void evaluate_view(gconstpointer model G_GNUC_UNUSED, const struct codec_query *query,
                          const struct codec_texels *texels, float ret[3]) {
    for (int c = 0; c < 3; c++)
        ret[c] += texels->share[0] * (0.5F + 0.5F * query->view[c]);
}

/* A geometric codec gets the direction from each texel to the camera, other codecs get that of the
 * layout. */
TEST(evaluated) {
    const struct wish wish = {.width = 40};
    g_autofree char *session = near_field_make_session("evaluated", &views, &lights, &wish);
    g_autoptr(BtfMatrix) btf = ok(btf_matrix_read(session, NULL, ERR));
    g_autoptr(CodecGeometry) geometry = ok(codec_geometry_read(btf, ERR));
    for (int i = 0; i < ALL * views.n * lights.n; i++) {
        const int texel = i / (views.n * lights.n), view = i / lights.n % views.n;
        double at[3], centre[3], to[3];
        near_field_camera_at(&views, view, at);
        near_field_texel_centre(texel, centre);
        near_field_towards(at, centre, to);
        for (int c = 0; c < 3; c++)
            btf->values[3 * i + c] = (float)(0.5 + 0.5 * to[c]);
    }
    for (int geometric = 0; geometric < 2; geometric++) {
        struct codec codec = material_btf_codec;
        codec.evaluate = evaluate_view;
        codec.geometric = geometric;
        g_autoptr(Material) model = material_borrow("view", &codec, btf);
        struct comparison *found =
            ok(held_out_compare(btf, &(struct held_out){.geometry = geometry}, model, NULL, ERR));
        g_test_message("geometric %d: %g", geometric, found->all.error);
        if (geometric)
            g_assert_cmpfloat(found->all.error, <, 1e-5);
        else
            g_assert_cmpfloat(found->all.error, >, 5e-3);
        comparison_free(found);
    }
}

/* Without a session, and without positions or an MDF. */
TEST(nothing) {
    g_autoptr(BtfMatrix) none = btf_fixture_new("none", 2, 2, 3, 4);
    const struct wish wish = {.width = 40, .nowhere = TRUE};
    g_autofree char *session = near_field_make_session("nowhere", &views, &lights, &wish);
    g_autoptr(BtfMatrix) btf = ok(btf_matrix_read(session, NULL, ERR));
    for (int k = 0; k < 2; k++) {
        g_autoptr(CodecGeometry) geometry = ok(codec_geometry_read(k ? btf : none, ERR));
        g_assert_cmpint(geometry->n_views, ==, k ? views.n : 3);
        g_assert_null(geometry->camera_mm);
        g_assert_null(geometry->lamp_mm);
        g_assert_cmpuint(geometry->n_points, ==, 0);
    }
}

BEFORE_TESTS {
    near_folder = g_dir_make_tmp("codec-geometry-XXXXXX", NULL);
    near_field_add_ring(&views, 20, 3, 0);
    near_field_add_ring(&views, 50, 4, 10);
    near_field_add_ring(&lights, 30, 5, 0);
}

AFTER_TESTS {
    remove_tree(near_folder);
    g_free(near_folder);
}
