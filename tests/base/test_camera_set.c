#include "base/camera_set.h"
#include "lib/test.h"

#include <string.h>

/* The cameras at both ends of each word of a set, and some others. */
static const int some[] = {0, 1, 30, 31, 32, 33, 62, 63, 64, 65, 70, 127, 128, 191, 192, 254, 255};

static void assert_text(struct camera_set set, const char *wanted) {
    g_autofree char *text = camera_set_to_text(set);
    g_assert_cmpstr(text, ==, wanted);
}

/* A table with one gboolean for each camera is the model of a set. */
static void assert_like(struct camera_set set, const gboolean model[CAMERA_SET_MAX]) {
    int n = 0, at = -1;
    for (int c = 0; c < CAMERA_SET_MAX; c++) {
        g_assert_cmpint(camera_set_has(set, c), ==, model[c]);
        if (!model[c])
            continue;
        g_assert_cmpint(camera_set_next(set, at), ==, c);
        at = c;
        n++;
    }
    g_assert_cmpint(camera_set_next(set, at), ==, -1);
    g_assert_cmpint(camera_set_count(set), ==, n);
    g_assert_cmpint(camera_set_is_empty(set), ==, n == 0);
}

TEST(one) {
    for (gsize i = 0; i < G_N_ELEMENTS(some); i++) {
        gboolean model[CAMERA_SET_MAX] = {FALSE};
        struct camera_set set = camera_set_of(some[i]);
        model[some[i]] = TRUE;
        assert_like(set, model);
        g_assert_false(camera_set_equal(set, (struct camera_set){{0}}));
        for (gsize k = 0; k < G_N_ELEMENTS(some); k++)
            g_assert_cmpint(camera_set_compare(set, camera_set_of(some[k])), ==, (i > k) - (i < k));
        camera_set_remove(&set, some[i]);
        g_assert_true(camera_set_equal(set, (struct camera_set){{0}}));
    }
}

TEST(out_of_range) {
    struct camera_set all = {{0}};
    for (int c = 0; c < CAMERA_SET_MAX; c++)
        camera_set_add(&all, c);
    g_assert_cmpint(camera_set_count(all), ==, 256);
    g_assert_false(camera_set_has(all, -1));
    g_assert_false(camera_set_has(all, CAMERA_SET_MAX));
    g_assert_cmpint(camera_set_next(all, CAMERA_SET_MAX - 1), ==, -1);
}

TEST(any) {
    GRand *rand = g_rand_new_with_seed(5);
    for (int round = 0; round < 200; round++) {
        gboolean a[CAMERA_SET_MAX] = {FALSE}, b[CAMERA_SET_MAX] = {FALSE};
        gboolean either[CAMERA_SET_MAX], both[CAMERA_SET_MAX], only[CAMERA_SET_MAX];
        struct camera_set x = {{0}}, y = {{0}};
        for (int k = g_rand_int_range(rand, 0, 300); k > 0; k--) {
            const int c = g_rand_int_range(rand, 0, CAMERA_SET_MAX);
            const gboolean first = g_rand_boolean(rand), add = g_rand_double(rand) < 0.8;
            (add ? camera_set_add : camera_set_remove)(first ? &x : &y, c);
            (first ? a : b)[c] = add;
        }
        for (int c = 0; c < CAMERA_SET_MAX; c++) {
            either[c] = a[c] || b[c];
            both[c] = a[c] && b[c];
            only[c] = a[c] && !b[c];
        }
        assert_like(x, a);
        assert_like(y, b);
        assert_like(camera_set_union(x, y), either);
        assert_like(camera_set_both(x, y), both);
        assert_like(camera_set_without(x, y), only);
        g_assert_cmpint(camera_set_equal(x, y), ==, memcmp(a, b, sizeof a) == 0);
        int highest = CAMERA_SET_MAX - 1;
        while (highest >= 0 && a[highest] == b[highest])
            highest--;
        g_assert_cmpint(camera_set_compare(x, y), ==, highest < 0 ? 0 : a[highest] ? 1 : -1);
        g_assert_cmpint(camera_set_compare(x, x), ==, 0);
        struct camera_set read = {{0}};
        g_autofree char *text = camera_set_to_text(x);
        g_assert_true(camera_set_from_text(text, &read));
        g_assert_true(camera_set_equal(x, read));
    }
    g_rand_free(rand);
}

TEST(text) {
    static const char *const wrong[] = {" ",  "0 ", " 0",  "0  1", "1 0", "3 3",  "255 3", "256",
                                        "-1", "+1", "0x1", "1,2",  "all", "0 1e", "1\n"};
    struct camera_set set = camera_set_of(70);
    camera_set_add(&set, 3);
    assert_text(set, "3 70");
    camera_set_add(&set, 255);
    assert_text(set, "3 70 255");
    assert_text((struct camera_set){{0}}, "");
    g_assert_true(camera_set_from_text("0 31 32 63 64 255", &set));
    assert_text(set, "0 31 32 63 64 255");
    for (gsize i = 0; i < G_N_ELEMENTS(wrong); i++) {
        g_assert_false(camera_set_from_text(wrong[i], &set));
        assert_text(set, "0 31 32 63 64 255");
    }
}
