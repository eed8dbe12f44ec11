/*
 * Property: every command that takes a kind of file reads all files of this kind that other
 * commands write. A session is captured; sessions are made of sessions by exporting and importing,
 * and by resampling, in random chains; random methods with random options compress them. Every
 * command for a session or a material then takes what came out, also next to files of other
 * sessions with the same directions.
 */
#include <stdlib.h>
#include <string.h>

#include "codecs/codecs.h"
#include "lib/operator.h"
#include "lib/test.h"

#define STEPS 4 /* sessions made of sessions; MESORIG_STEPS in the environment: more */
#define SEED  20261123

#define DOES(...) operator_does(chain->run, 0, __VA_ARGS__, NULL)

struct chain {
    struct operation *run;
    GRand *random;
    GPtrArray *sessions;  /* of char *: paths, all with the same directions */
    GPtrArray *materials; /* of char *: files of codecs, of any of the sessions */
    int n_files;
};

static const char *any_of(struct chain *chain, const GPtrArray *from) {
    return from->pdata[g_rand_int_range(chain->random, 0, (gint32)from->len)];
}

static char *new_file(struct chain *chain, const char *suffix) {
    g_autofree char *name = g_strdup_printf("any%d%s", chain->n_files++, suffix);
    return g_build_filename(chain->run->directory, name, NULL);
}

static void read_session(struct chain *chain, const char *session) {
    g_autofree char *page = new_file(chain, ".html");
    DOES("info", session);
    DOES("check", session);
    DOES("report", session, "-o", page);
    DOES("report", session, "--crate");
    DOES("compare", session, any_of(chain, chain->sessions));
    if (chain->materials->len > 0)
        DOES("compare", session, any_of(chain, chain->materials));
}

static void read_material(struct chain *chain, const char *file, const char *method) {
    static const char *const kinds[] = {"normals", "height"};
    DOES("info", file);
    DOES("compare", any_of(chain, chain->sessions), file);
    DOES("compare", file, any_of(chain, chain->materials));
    for (gsize i = 0; i < G_N_ELEMENTS(kinds); i++)
        if (g_str_equal(method, "ptm") || g_str_equal(method, "hsh")) {
            g_autofree char *map = new_file(chain, ".exr");
            DOES("export", kinds[i], file, "-o", map);
            DOES("info", map);
        }
}

/* With an option that the method has, or none. */
static void compress_with(struct chain *chain, const char *session, const char *method) {
    static const struct {
        const char *method, *option;
    } options[] = {{"lpca", "--clusters=2"},    {"lpca", "--quantise=float"},
                   {"lpca", "--quantise=8bit"}, {"lpca", "--quantise=8bit-weights"},
                   {"lpca", "--error=5%"},      {"lpca", "--colours=log"},
                   {"lpca", "--grid=4"},        {"lpca", "--size=1MB"},
                   {"lpca", "--mips"},          {"eigenmaps", "--components=2"},
                   {"eigenmaps", "--error=5%"}, {"fields", "--components=1"},
                   {"fields", "--mips"},        {"ptm", "--mips"},
                   {"hsh", "--terms=4"},        {"lafortune", "--components=1"},
                   {"ward", "--mips"}};
    char *file = new_file(chain, ".exr");
    const char *option = NULL;
    int n = 1;
    for (gsize i = 0; i < G_N_ELEMENTS(options); i++)
        if (g_str_equal(options[i].method, method) && g_rand_int_range(chain->random, 0, ++n) == 0)
            option = options[i].option;
    g_test_message("compress %s -m %s %s", session, method, option ? option : "");
    DOES("compress", session, "-m", method, "-o", file, option);
    g_ptr_array_add(chain->materials, file);
    read_material(chain, file, method);
}

/* A session of another one, with the same directions. */
static void derive(struct chain *chain, const char *from) {
    static const char *const formats[] = {"--format=bdi", "--format=fmf", "--format=dfmf"};
    char *session = new_file(chain, ".session");
    if (g_rand_int_range(chain->random, 0, 3) == 0) {
        g_test_message("resample %s", from);
        DOES("resample", from, "-o", session);
    } else {
        g_autofree char *file = new_file(chain, ".btf");
        const char *format = formats[g_rand_int_range(chain->random, 0, G_N_ELEMENTS(formats))];
        const gboolean factors = !g_str_equal(format, formats[0]);
        g_test_message("export and import %s %s", from, format);
        DOES("export", "btf", from, "-o", file, format, factors ? "--components=3" : NULL);
        DOES("import", "btf", file, "-o", session);
    }
    g_ptr_array_add(chain->sessions, session);
}

/* The files of a session that was measured: its distances and its surface, in all forms. */
static void read_measured(struct chain *chain) {
    static const char *const outputs[][2] = {
        {"points", ".ply"}, {"mesh", ".ply"}, {"height", ".exr"}, {"normals", ".exr"}};
    static const char *const methods[] = {"mdf", "mdf-views"};
    const char *session = chain->run->session;
    g_autofree char *history = new_file(chain, ".svg");
    DOES("info", session, "--history", history);
    for (gsize i = 0; i < G_N_ELEMENTS(outputs); i++) {
        g_autofree char *file = new_file(chain, outputs[i][1]);
        DOES("export", outputs[i][0], session, "-o", file);
        if (g_str_has_suffix(file, ".exr"))
            DOES("info", file);
    }
    for (gsize i = 0; i < G_N_ELEMENTS(methods); i++) {
        g_autofree char *file = new_file(chain, ".exr");
        DOES("compress", session, "-m", methods[i], "-o", file);
        DOES("info", file);
    }
}

TEST(chain) {
    const char *asked = g_getenv("MESORIG_STEPS");
    const int steps = asked ? atoi(asked) : STEPS;
    struct chain chain_of = {operator_new(NULL), g_rand_new_with_seed(SEED),
                             g_ptr_array_new_with_free_func(g_free),
                             g_ptr_array_new_with_free_func(g_free), 0};
    struct chain *chain = &chain_of;
    operator_captures(chain->run, 0);
    DOES("process", chain->run->session);
    g_ptr_array_add(chain->sessions, g_strdup(chain->run->session));
    read_measured(chain);
    read_session(chain, chain->run->session);
    int n_methods = 0;
    while (codecs[n_methods])
        n_methods++;
    for (int i = 0; i < MAX(steps, n_methods); i++) { /* each method at least once */
        if (i < steps)
            derive(chain, any_of(chain, chain->sessions));
        compress_with(chain, any_of(chain, chain->sessions), codecs[i % n_methods]->name);
        if (i < steps)
            read_session(chain, chain->sessions->pdata[chain->sessions->len - 1]);
    }
    for (guint i = 0; i < chain->sessions->len; i++)
        DOES("verify", chain->sessions->pdata[i]);
    g_ptr_array_unref(chain->sessions);
    g_ptr_array_unref(chain->materials);
    g_rand_free(chain->random);
    operator_free(chain->run);
}

TESTS_RUN_BY(operator_tests);
