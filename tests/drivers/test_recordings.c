/* Every recording of tests/recordings through its driver, and recordings of the virtual devices.
 *
 * MESORIG_RECORDINGS=FOLDER makes the recordings of the virtual devices again, as FOLDER/NAME.rec.
 */
#include "lib/device_by_text.h"
#include "lib/ok.h"
#include "lib/program_model.h"
#include "lib/remove_tree.h"
#include "lib/replaying.h"
#include "lib/test.h"
#include "lib/text_file.h"
#include "lib/wait.h"

#include "drivers/recording.h"
#include "lib/modbus_rig.h"
#include "virtual/dmx_node.h"
#include "virtual/gcode.h"
#include "virtual/leds.h"
#include "virtual/replay/protocol.h"
#include "virtual/replay/replay.h"
#include "virtual/testbed.h"
#include "virtual/usb_relays.h"
#include "virtual/usb_tic.h"
#include "virtual/wled.h"

#include <arpa/inet.h>
#include <string.h>

#define FOLDER SOURCE_DIR "/tests/recordings"

static Clock *clock_real;

/* Changes a byte of a request that the recording has once, about in the middle of those. The byte
 * is not part of a number or check sum that a replay ignores. Returns the line. */
static int change_request(const Recorded *recorded) {
    g_autoptr(GHashTable) keys =
        g_hash_table_new_full(g_bytes_hash, g_bytes_equal, (GDestroyNotify)g_bytes_unref, NULL);
    g_autoptr(GPtrArray) news = g_ptr_array_new();
    for (guint i = 0; i < recorded->lines->len; i++) {
        struct recorded_line *line = recorded->lines->pdata[i];
        if (line->way != '>')
            continue;
        const char *kind = recorded->kinds->pdata[line->bus - 1];
        const struct replay_protocol *protocol = replay_protocol_find(kind, recorded->sections);
        gsize n;
        const guint8 *bytes = g_bytes_get_data(line->bytes, &n);
        GBytes *key = protocol->key(bytes, n);
        if (key && g_hash_table_add(keys, key))
            g_ptr_array_add(news, line);
    }
    g_assert_cmpuint(news->len, >, 0);
    struct recorded_line *line = news->pdata[news->len / 2];
    const struct replay_protocol *protocol =
        replay_protocol_find(recorded->kinds->pdata[line->bus - 1], recorded->sections);
    gsize n;
    const guint8 *bytes = g_bytes_get_data(line->bytes, &n);
    g_autoptr(GBytes) before = protocol->key(bytes, n);
    for (gsize i = n; i-- > 0;) {
        g_autofree guint8 *changed = g_memdup2(bytes, n);
        changed[i] ^= 1;
        g_autoptr(GBytes) after = protocol->key(changed, n);
        if (!after || g_bytes_equal(before, after) || strchr("\n\r\v\f", changed[i]))
            continue;
        g_bytes_unref(line->bytes);
        line->bytes = g_bytes_new(changed, n);
        return line->number;
    }
    g_assert_not_reached();
}

/* Replays a recording that the driver does not follow. The driver may warn. */
static char *replay_wrong(const Recorded *recorded) {
    const GLogLevelFlags fatal = g_log_set_always_fatal(G_LOG_LEVEL_ERROR | G_LOG_LEVEL_CRITICAL);
    char *why = replaying(recorded);
    g_log_set_always_fatal(fatal);
    return why;
}

/* A replay notices a request that is not the one of the recording, and names its line. */
static void notice(gconstpointer path) {
    g_autofree char *text = text_file_read(path);
    g_autoptr(Recorded) recorded = ok(recorded_parse(text, path, ERR));
    const int line = change_request(recorded);
    g_autofree char *start = g_strdup_printf("%s:%d: expected “", (const char *)path, line);
    g_autofree char *why = replay_wrong(recorded);
    if (!why || !g_str_has_prefix(why, start))
        g_error("line %d was changed, but the replay says: %s", line, why ? why : "nothing");
}

static void replay_file(gconstpointer path) {
    g_autofree char *text = text_file_read(path);
    replaying_well(text, path);
}

/* Opens a device, does some calls one after another, and closes it. Returns the recording. */
static char *record(const char *sections, const char *const *calls) {
    g_autoptr(Config) config = ok(config_parse(sections, "./test.conf", ERR));
    gsize n;
    recording_begin();
    DeviceByText *device = ok(device_by_text_open(config_sections(config, &n), clock_real, ERR));
    for (int i = 0; calls[i]; i++) {
        device_by_text_call(device, calls[i]);
        UNTIL (device_by_text_results(device) > i)
            wait_ms(5);
    }
    device_by_text_close(device);
    char *text = recording_end();
    g_assert_nonnull(text);
    return text;
}

/* Replays the recording of a virtual device. */
static void replay_model(const char *name, const char *made) {
    const char *folder = g_getenv("MESORIG_RECORDINGS");
    g_autoptr(GString) text = g_string_new(made);
    const char *kernel = strstr(made, "kernel = ");
    g_assert_nonnull(kernel);
    g_string_erase(text, kernel - made, strchr(kernel, '\n') + 1 - kernel);
    g_assert_cmpuint(
        g_string_replace(text, "made from = a device", "made from = a model of this project", 1),
        ==, 1);
    if (folder) {
        g_autofree char *file = g_strdup_printf("%s.rec", name);
        text_file_write(folder, file, text->str);
    }
    replaying_well(text->str, name);
}

static void record_and_replay(const char *name, const char *sections, const char *const *calls) {
    g_autofree char *made = record(sections, calls);
    replay_model(name, made);
}

static const char *const moves[] = {"home", "move to 5.0000", "move to 2.0000", NULL};
static const char *const switches[] = {"lamp 0 on", "lamp 0 off", "lamp 2 on",
                                       "lamp 1 on", "lamps off",  NULL};

static const struct virtual_gcode_options board = {.n_axes = 3,
                                                   .units_s = 100,
                                                   .units_s2 = 1000,
                                                   .steps = 80,
                                                   .home_at = 0,
                                                   .switch_way = 20,
                                                   .boot_ms = 20};

static char *gcode_section(VirtualGcode *model, const char *dialect) {
    return g_strdup_printf("[axis turntable]\ndriver = gcode-axis\nport = %s\ndialect = %s\n"
                           "letter = X\nunits_per_deg = 1\nspeed_deg_s = 20\naccel_deg_s2 = 100\n"
                           "min_deg = -90\nmax_deg = 90\nboot_ms = 2000\nhoming_s = 5\n",
                           virtual_gcode_port(model), dialect);
}

TEST(grbl) {
    struct virtual_gcode_options with = board;
    with.resets_on_open = TRUE;
    g_autoptr(VirtualGcode) model = ok(virtual_gcode_new(&with, ERR));
    g_autofree char *section = gcode_section(model, "grbl");
    static const char *const turns[] = {"home",           "move to 5.0000",
                                        "move to 2.0000", "turn by 12.0000 at 15.0000",
                                        "move to 0.0000", NULL};
    record_and_replay("gcode-axis-grbl", section, turns);
}

TEST(marlin) {
    struct virtual_gcode_options with = board;
    with.language = VIRTUAL_MARLIN;
    with.emergency_parser = TRUE;
    g_autoptr(VirtualGcode) model = ok(virtual_gcode_new(&with, ERR));
    g_autofree char *section = gcode_section(model, "marlin");
    record_and_replay("gcode-axis-marlin", section, moves);
}

TEST(serial_lamps) {
    const struct virtual_leds_options options = {.n = 4, .dark_ms = 2000, .boot_ms = 20};
    g_autoptr(VirtualLeds) model = ok(virtual_leds_new(&options, ERR));
    g_autofree char *section = g_strdup_printf("[lamps bank]\ndriver = serial-lamps\nport = %s\n",
                                               virtual_leds_port(model));
    record_and_replay("serial-lamps", section, switches);
}

static void modbus(gboolean rtu, const char *name, const char *header, const char *keys,
                   const char *const *calls) {
    g_autoptr(VirtualModbus) model = modbus_rig_device(rtu);
    /* No answer is late, even on a busy computer. */
    g_autofree char *section =
        g_strdup_printf("[%s]\nbus = %s\nunit = %d\ntimeout_ms = 300\nlate_ms = 120\n%s", header,
                        virtual_modbus_bus(model), RIG_UNIT, keys);
    record_and_replay(name, section, calls);
}

TEST(modbus_axis) {
    modbus(TRUE, "modbus-axis", "axis arc", "driver = modbus-axis\n" RIG_AXIS, moves);
}

TEST(modbus_relays) {
    modbus(FALSE, "modbus-relays", "lamps bank", "driver = modbus-relays\nn = 3\nfirst_coil = 4\n",
           switches);
}

TEST(modbus_laser) {
    static const char *const calls[] = {"on", "off", NULL};
    modbus(TRUE, "modbus-laser", "laser line",
           "driver = modbus-laser\ncoil = 9\nwatchdog_register = 6\n" RIG_AFTER, calls);
}

TEST(modbus_inputs) {
    static const char *const none[] = {NULL};
    modbus(FALSE, "modbus-inputs", "interlock door", "driver = modbus-inputs\ninput = 2\n", none);
}

/* Records a device in the network, and replays the recording. The recording has no address and no
 * name of the network. */
static void record_network(const char *name, const char *section) {
    static const char *const personal[] = {"02 1b c5", "021bc5", "02:1B:C5", "Virtual WLED"};
    g_autofree char *text = record(section, switches);
    for (gsize i = 0; i < G_N_ELEMENTS(personal); i++)
        g_assert_null(strstr(text, personal[i]));
    for (int i = 0; i <= 2; i += 2) {
        const char *address = virtual_dmx_address(i);
        guint8 bytes[4];
        g_assert_cmpint(inet_pton(AF_INET, address, bytes), ==, 1);
        g_autofree char *digits =
            g_strdup_printf("%02x %02x %02x %02x", bytes[0], bytes[1], bytes[2], bytes[3]);
        g_assert_null(strstr(text, address));
        g_assert_null(strstr(text, digits));
    }
    replay_model(name, text);
}

static void dmx(gboolean sacn) {
    const struct virtual_dmx_options options = {
        .sacn = sacn, .address = virtual_dmx_address(2), .universe = 1, .n = 1};
    g_autoptr(VirtualDmx) model = ok(virtual_dmx_new(&options, ERR));
    g_autofree char *section = g_strdup_printf(
        "[lamps dome]\ndriver = %s-lamps\naddress = %s\nlocal_address = %s\nuniverse = 1\nn = 4\n",
        sacn ? "sacn" : "artnet", virtual_dmx_address(2), virtual_dmx_address(0));
    record_network(sacn ? "sacn-lamps" : "artnet-lamps", section);
}

TEST(artnet_lamps) {
    dmx(FALSE);
}

TEST(sacn_lamps) {
    dmx(TRUE);
}

TEST(wled_lamps) {
    g_autoptr(VirtualWled) model = ok(virtual_wled_new(virtual_dmx_address(2), 100, ERR));
    g_autofree char *section = g_strdup_printf(
        "[lamps ring]\ndriver = wled-lamps\naddress = %s\nhttp_port = %d\nlocal_address = %s\n"
        "n = 4\nleds = 12\n",
        virtual_dmx_address(2), virtual_wled_http_port(model), virtual_dmx_address(0));
    record_network("wled-lamps", section);
}

static void program(const char *class_name, const char *keys, const char *const *calls) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *section = program_model_section(class_name, folder, 20, keys);
    g_autofree char *name = g_strdup_printf("program-%s", class_name);
    record_and_replay(name, section, calls);
}

TEST(program_lamps) {
    program("lamps", "", switches);
}

TEST(tic_axis) {
    g_autoptr(VirtualTic) model = virtual_tic_new("00123456", 1, 4000, 100);
    const char *section =
        "[axis test]\ndriver = tic-axis\nsteps_per_deg = 100\nmin_deg = 0\nmax_deg = 38\n"
        "speed_deg_s = 60\naccel_deg_s2 = 600\nsettle_ms = 10\npoll_ms = 10\n";
    g_autofree char *text = record(section, moves);
    g_clear_pointer(&model, virtual_tic_free);
    g_assert_null(strstr(text, "00123456")); /* neither as text nor in a string descriptor */
    g_assert_null(strstr(text, "30 00 30 00 31 00 32 00"));
    replay_model("tic-axis", text);
}

TEST(usb_relays) {
    g_autoptr(VirtualRelays) model = virtual_relays_new("USBRelay4", "LAMPS", 2, FALSE);
    g_autofree char *text = record("[lamps bank]\ndriver = usb-relays\nserial = LAMPS\n", switches);
    g_clear_pointer(&model, virtual_relays_free);
    g_assert_null(strstr(text, "LAMPS"));
    g_assert_null(strstr(text, "4c 41 4d 50 53"));
    replay_model("usb-relays", text);
}

/* Changes the first occurrence of a text in a recording. */
static char *with(const char *name, const char *text, const char *instead) {
    g_autofree char *path = g_strdup_printf(FOLDER "/%s.rec", name);
    g_autofree char *read = text_file_read(path);
    g_autoptr(GString) changed = g_string_new(read);
    g_assert_cmpuint(g_string_replace(changed, text, instead, 1), ==, 1);
    return g_string_free(g_steal_pointer(&changed), FALSE);
}

static void expect(const char *text, const char *words) {
    g_autoptr(Recorded) recorded = ok(recorded_parse(text, "changed", ERR));
    g_autofree char *why = replay_wrong(recorded);
    if (!why || !strstr(why, words))
        g_error("the replay says “%s”, not “%s”", why ? why : "nothing", words);
}

/* A request that the recording does not have, and one that does not come. */
TEST(differs__more) {
    g_autofree char *text =
        with("modbus-relays", "> 07 05 00 06 ff 00\n", "- \"the driver has forgotten it\"\n");
    expect(text, "but the program sent “07 05 00 06 ff 00”");
}

TEST(differs__less) {
    g_autofree char *text = with("modbus-relays", "[lamps bank] = lamp 1 on\n",
                                 "[lamps bank] = lamp 1 on\n1 @1 > 07 05 00 08 ff 00\n"
                                 "1 @1 < 07 05 00 08 ff 00\n");
    expect(text, ": expected “07 05 00 08 ff 00”, but nothing came");
}

/* A command must come as often as in the recording, also the same one again. */
TEST(differs__repeated) {
    g_autofree char *text = with("modbus-relays", "[lamps bank] = lamps off\n",
                                 "[lamps bank] = lamps off\n1 @1 > 07 0f 00 04 00 03 01 00\n"
                                 "1 @1 < 07 0f 00 04 00 03\n");
    expect(text, ": expected “07 0f 00 04 00 03 01 00”, but nothing came");
}

TEST(differs__again) {
    g_autofree char *text = with("modbus-relays", "[lamps bank] close\n", "[lamps bank] close\n#");
    *strrchr(text, '#') = 0; /* what follows */
    expect(text, "the recording has ended, but the program sent “07 0f 00 04 00 03 01 00”");
}

/* The driver believes what the device says. A lamp that reads back as off was not lit, so the
 * driver does something else than in the recording. */
TEST(differs__answer) {
    g_autofree char *text = with("modbus-relays", "< 07 01 01 01\n", "< 07 01 01 00\n");
    expect(text, "expected");
}

#define LIT "> 41 72 74 2d 4e 65 74 00 00 50 00 0e 00 00 01 00 02 00 ff 00*511\n"

/* Levels that do not change may be sent more often or less often. */
TEST(no_news) {
    g_autofree char *less = with("artnet-lamps", LIT, LIT "1 @1 " LIT "2 @1 " LIT);
    replaying_well(less, "less");
    g_autofree char *more = with("artnet-lamps", LIT, "- \"left out\"\n");
    replaying_well(more, "more");
}

TEST(mistakes) {
    static const struct {
        const char *text, *error;
    } files[] = {
        {"", "x:1: it is not a recording of version 1"},
        {"mesorig-recording 2\n", "x:1: it is not a recording of version 1"},
        {"mesorig-recording 1\n@2 = serial\n", "x:2: the buses must be numbered from @1 on"},
        {"mesorig-recording 1\n12 @1 > 00\n",
         "x:2: a bus that the head lists, such as @1, or a [device]"},
        {"mesorig-recording 1\n@1 = serial\n1 @1 = 00\n", "x:3: “ > ”, “ < ” or “ - ” must"},
        {"mesorig-recording 1\n@1 = serial\n1 @1 > 0\n", "x:3: the message is neither a text"},
        {"mesorig-recording 1\n@1 = serial\n1 @1 > 00*99999999\n", "x:3: the message is neither"},
        {"mesorig-recording 1\n@1 = serial\n1 @1 > \"a\\q\"\n", "x:3: the message is neither"},
        {"mesorig-recording 1\n@1 = serial\n1 @1 > \"a\n", "x:3: the message is neither"},
        {"mesorig-recording 1\n1 [axis\n", "x:2: “]” and a text must follow the device"},
        {"mesorig-recording 1\n1x\n", "x:2: the line must begin with a time in µs"},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(files); i++) {
        g_autoptr(GError) error = NULL;
        g_assert_null(recorded_parse(files[i].text, "x", &error));
        if (!error || !g_str_has_prefix(error->message, files[i].error))
            g_error("file %zu: “%s”", i, error ? error->message : "no error");
    }
}

BEFORE_TESTS {
    g_autoptr(GDir) folder = ok(g_dir_open(FOLDER, 0, ERR));
    const char *name;
    clock_real = clock_new_real();
    while ((name = g_dir_read_name(folder))) {
        g_autofree char *test = g_strdup_printf("/recordings/file/%s", name);
        g_autofree char *other = g_strdup_printf("/recordings/notice/%s", name);
        if (!g_str_has_suffix(name, ".rec"))
            continue;
        g_test_add_data_func_full(test, g_build_filename(FOLDER, name, NULL), replay_file, g_free);
        g_test_add_data_func_full(other, g_build_filename(FOLDER, name, NULL), notice, g_free);
    }
}

AFTER_TESTS {
    clock_unref(clock_real);
}

int main(int argc, char **argv) {
    testbed_enter(argv);
    return tests_run(argc, argv);
}
