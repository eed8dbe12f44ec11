#include "relays.h"

#include "usb.h"

#include <string.h>

/*
 * The boards take feature reports of 8 bytes by HID's SET_REPORT: a command, then the number of a
 * relay, counted from 1. GET_REPORT answers 8 bytes: the board's serial number in bytes 0 to 4, and
 * one bit per relay in byte 7. The protocol is that of the boards' firmware,
 * https://github.com/pavel-a/usb-relay-hid. The firmware has no watchdog, so watchdog_s stays 0.
 * Vendor and product ids are those of V-USB for any HID device, so the name of the product
 * identifies a board.
 */
#define VENDOR      0x16c0
#define CLASS_HID   3
#define REPORT_SIZE 8
#define STATE_BYTE  7
#define SERIAL_SIZE 5
#define FEATURE     0x0300 /* report type feature, no report number */
#define ANSWER_MS   600    /* USB 2.0, 9.2.6: a device may take 500 ms for its data */
#define MAX_RELAYS  8

enum report_request { GET_REPORT = 0x01, SET_REPORT = 0x09 };
enum report_type { REPORT_OUT = 0x21, REPORT_IN = 0xa1 };
enum command { ALL_OFF = 0xfc, OFF = 0xfd, ON = 0xff };

typedef void (*SwitchedFunc)(gpointer device, int index, gboolean on, GError *error);

/* A board, shared by all devices that select it in the same way. */
struct board {
    int refs;
    char *who, *serial, *path;
    UsbDevice *usb; /* NULL if it is unplugged */
    int n;          /* number of relays */
    GList *jobs;    /* jobs that have not ended */
    GList *users;   /* of struct usb_relays: the open devices on the board */
};

/* State of a lamp bank or a laser: its relays on a board. */
struct usb_relays {
    char *serial, *path;
    int first, n;
    double warm_up_ms;
    struct board *board;
    gpointer device;
    gboolean (*may_shine)(gpointer device);
    void (*lost)(gpointer device, GError *error); /* takes ownership of the error */
    /* the board was unplugged, and lost() is still to be called */
    gboolean unplugged;
};

/* A job that switches some relays and reads them back. */
struct job {
    struct board *board;
    gpointer device; /* NULL if the device was closed meanwhile; its func is then not called */
    SwitchedFunc func;
    int index;
    gboolean on;
    guint mask;
    int n_left;    /* number of requests that have not ended */
    GError *error; /* the first error */
};

static GList *boards;

static const guint16 products[] = {0x05df, 0};

static void relays_job_free(gpointer data) {
    struct job *job = data;
    g_clear_error(&job->error);
    g_free(job);
}

static void on_set(UsbDevice *usb, const guint8 *data, gsize n, const GError *error,
                   gpointer user) {
    struct job *job = user;
    struct board *board = job->board;
    if (error && !job->error)
        job->error = g_error_copy(error);
    if (--job->n_left > 0)
        return;
    board->jobs = g_list_remove(board->jobs, job);
    if (job->device)
        job->func(job->device, job->index, job->on, g_steal_pointer(&job->error));
    relays_job_free(job);
}

static void on_read_back(UsbDevice *usb, const guint8 *data, gsize n, const GError *error,
                         gpointer user) {
    struct job *job = user;
    guint wrong = (n == REPORT_SIZE ? data[STATE_BYTE] ^ (job->on ? 0xffu : 0) : 0) & job->mask;
    if (!error && !job->error && n != REPORT_SIZE)
        job->error = device_error_new(
            DEVICE_ERROR_PROTOCOL, job->board->who,
            "the board answered %d bytes of %d, so it is not a relay board that this driver "
            "knows" ERROR_ADVICE "use another relay board",
            (int)n, REPORT_SIZE);
    else if (!error && !job->error && wrong)
        job->error = device_error_new(
            DEVICE_ERROR_PROTOCOL, job->board->who,
            "relay %d was switched %s, but the board reports that it is %s" ERROR_ADVICE
            "check the board's power",
            g_bit_nth_lsf(wrong, -1) + 1, job->on ? "on" : "off", job->on ? "off" : "on");
    on_set(usb, data, n, error, user);
}

static void board_unref(struct board *board);

static struct usb_relays *next_unplugged(const struct board *board) {
    for (GList *l = board->users; l; l = l->next) {
        struct usb_relays *relays = l->data;
        if (relays->unplugged)
            return relays;
    }
    return NULL;
}

/* Reports the loss of a board to the devices on it that may shine. They may shine because a board
 * with a separate power supply keeps its relays on. Listeners may close devices and thereby free
 * the board. */
static void relays_on_lost(UsbDevice *usb, gpointer user) {
    struct board *board = user;
    struct usb_relays *relays;
    g_clear_pointer(&board->usb, usb_close);
    board->refs++;
    for (GList *l = board->users; l; l = l->next) {
        relays = l->data;
        relays->unplugged = relays->may_shine(relays->device);
    }
    while ((relays = next_unplugged(board))) {
        relays->unplugged = FALSE;
        relays->lost(relays->device, device_error_new(DEVICE_ERROR_DISCONNECTED,
                                                      ((const struct device *)relays->device)->who,
                                                      "its relay board was unplugged" ERROR_ADVICE
                                                      "plug it in again"));
    }
    board_unref(board);
}

static struct usb_request set_request(const UsbDevice *usb, const guint8 report[REPORT_SIZE]) {
    return (struct usb_request){REPORT_OUT,         SET_REPORT, FEATURE,
                                usb_interface(usb), report,     REPORT_SIZE};
}

static struct usb_request get_request(const UsbDevice *usb) {
    return (struct usb_request){REPORT_IN,          GET_REPORT, FEATURE,
                                usb_interface(usb), NULL,       REPORT_SIZE};
}

/* Reads the serial number that the board keeps in its reports. The board has none in its
 * descriptors. Returns "" if the report cannot be read. */
static char *read_serial(UsbDevice *usb) {
    guint8 answer[REPORT_SIZE];
    struct usb_request request = get_request(usb);
    if (usb_control_sync(usb, &request, answer, NULL) != REPORT_SIZE)
        return g_strdup("");
    g_autofree char *serial = g_strndup((const char *)answer, SERIAL_SIZE);
    return g_utf8_make_valid(serial, -1);
}

static gboolean board_connect(struct board *board, GError **error) {
    struct usb_match match = {.who = board->who,
                              .vendor = VENDOR,
                              .products = products,
                              .product_prefix = "USBRelay",
                              .interface_class = CLASS_HID,
                              .serial = board->serial,
                              .path = board->path,
                              .read_serial = read_serial};
    board->usb = usb_open(&match, relays_on_lost, board, error);
    if (!board->usb)
        return FALSE;
    const char *number = usb_product(board->usb) + strlen(match.product_prefix);
    board->n = g_ascii_isdigit(*number) ? *number - '0' : 0;
    if (board->n >= 1 && board->n <= MAX_RELAYS)
        return TRUE;
    device_error_set(error, DEVICE_ERROR_PROTOCOL, board->who,
                     "the board calls itself \"%s\", not USBRelay1 to USBRelay8" ERROR_ADVICE
                     "use another relay board",
                     usb_product(board->usb));
    g_clear_pointer(&board->usb, usb_close);
    return FALSE;
}

static void board_unref(struct board *board) {
    if (--board->refs > 0)
        return;
    boards = g_list_remove(boards, board);
    usb_close(board->usb);
    g_list_free_full(board->jobs, relays_job_free);
    g_free(board->who);
    g_free(board->serial);
    g_free(board->path);
    g_free(board);
}

static gboolean job_send(struct job *job, enum command command, int relay, GError **error) {
    guint8 report[REPORT_SIZE] = {(guint8)command, (guint8)relay};
    struct usb_request set = set_request(job->board->usb, report);
    if (!usb_control(job->board->usb, &set, ANSWER_MS, on_set, job, error))
        return FALSE;
    job->n_left++;
    return TRUE;
}

/* Switches the relays of a mask. If the board was unplugged, first looks for it again. Returns TRUE
 * if a request was sent. func is then called once, when all requests have ended. Otherwise returns
 * FALSE with an error, and func is not called. */
static gboolean board_switch(struct board *board, guint mask, gboolean on, SwitchedFunc func,
                             gpointer device, int index, GError **error) {
    if (!board->usb && !board_connect(board, error))
        return FALSE;
    struct job *job = g_new0(struct job, 1);
    *job = (struct job){board, device, func, index, on, mask};
    struct usb_request get = get_request(board->usb);
    gboolean all_off = !on && mask == (1u << board->n) - 1;
    gboolean ok = !all_off || job_send(job, ALL_OFF, 0, &job->error);
    for (int i = 0; ok && !all_off && i < board->n; i++)
        ok = !(mask & 1u << i) || job_send(job, on ? ON : OFF, i + 1, &job->error);
    if (ok && usb_control(board->usb, &get, ANSWER_MS, on_read_back, job, &job->error))
        job->n_left++;
    if (job->n_left == 0) {
        g_propagate_error(error, job->error);
        g_free(job);
        return FALSE;
    }
    /* Some requests may be under way despite the error. The end of the last request reports the
     * error. */
    board->jobs = g_list_append(board->jobs, job);
    return TRUE;
}

/* Switches the relays of a mask off and waits until the board has confirmed it. Only for opening
 * and closing. Requests that were started earlier end first. */
static gboolean board_off_now(struct board *board, guint mask, GError **error) {
    guint8 answer[REPORT_SIZE] = {0};
    gboolean all = mask == (1u << board->n) - 1;
    for (int i = 0; i < board->n; i++) {
        guint8 report[REPORT_SIZE] = {all ? ALL_OFF : OFF, (guint8)(all ? 0 : i + 1)};
        struct usb_request set = set_request(board->usb, report);
        if ((all ? i == 0 : (mask & 1u << i) != 0) &&
            usb_control_sync(board->usb, &set, NULL, error) < 0)
            return FALSE;
    }
    struct usb_request get = get_request(board->usb);
    int n = usb_control_sync(board->usb, &get, answer, error);
    if (n < 0)
        return FALSE;
    if (n == REPORT_SIZE && !(answer[STATE_BYTE] & mask))
        return TRUE;
    if (n != REPORT_SIZE)
        return device_error_set(
            error, DEVICE_ERROR_PROTOCOL, board->who,
            "the board answered %d bytes of %d, so it is not known whether its relays are "
            "off" ERROR_ADVICE "cut the power of the lamps or the laser that it switches",
            n, REPORT_SIZE);
    return device_error_set(
        error, DEVICE_ERROR_PROTOCOL, board->who,
        "its relays do not switch off" ERROR_ADVICE
        "check the board, and cut the power of the lamps or the laser that it switches");
}

static void board_leave(struct usb_relays *relays, guint mask) {
    struct board *board = relays->board;
    gpointer device = relays->device;
    g_autoptr(GError) error = NULL;
    board->users = g_list_remove(board->users, relays);
    for (GList *l = board->jobs; l; l = l->next) {
        struct job *job = l->data;
        if (job->device == device)
            job->device = NULL;
    }
    if (board->usb && !board_off_now(board, mask, &error))
        g_warning("%s", error->message);
    board_unref(board);
}

/* Returns a mask with the bits of n relays. The number of the first relay is counted from 1, and
 * relay 1 has bit 0. */
static guint mask_of(int first, int n) {
    return ((1u << n) - 1) << (first - 1);
}

/* Takes relays of a board for a device and switches them off. If *n is 0, takes all relays from
 * the first one on and sets *n to their number. Returns NULL with an error on failure. */
static struct board *board_enter(struct device *device, struct usb_relays *relays, int *n,
                                 GError **error) {
    const char *name = *relays->serial ? relays->serial : relays->path;
    struct board *board = NULL;
    for (GList *l = boards; l && !board; l = l->next) {
        struct board *other = l->data;
        if (g_str_equal(other->serial, relays->serial) && g_str_equal(other->path, relays->path))
            board = other;
    }
    if (!board) {
        board = g_new0(struct board, 1);
        board->serial = g_strdup(relays->serial);
        board->path = g_strdup(relays->path);
        board->who = g_strdup_printf("USB relay board%s%s", *name ? " " : "", name);
        boards = g_list_append(boards, board);
    }
    board->refs++;
    if (!board->usb && !board_connect(board, error)) {
        error_details_add_subject(error, device->who);
        board_unref(board);
        return NULL;
    }
    device_set_identity(device, usb_product(board->usb), usb_serial(board->usb), relays->path);
    if (*n == 0)
        *n = board->n - relays->first + 1;
    if (*n < 1 || relays->first + *n - 1 > board->n)
        config_set_error(
            error, CONFIG_ERROR_VALUE, device->section, NULL,
            "relay %d does not exist, because the USB relay board has %d relays; correct relay, "
            "or first_relay and n_lamps",
            relays->first + MAX(*n, 1) - 1, board->n);
    else if (board_off_now(board, mask_of(relays->first, *n), error)) {
        board->users = g_list_append(board->users, relays);
        return board;
    }
    board_unref(board);
    return NULL;
}

/* Appends the names of the relays that a section needs. n = 0 means all relays from the first one
 * on. */
static void relays_need(const struct usb_relays *relays, int n, GPtrArray *to) {
    g_autofree char *board = usb_words("USB relay board", relays->serial, relays->path);
    const int end = n ? relays->first + n : MAX_RELAYS + 1;
    for (int i = relays->first; i < end; i++)
        g_ptr_array_add(to, g_strdup_printf("relay %d of %s", i, board));
}

static void relays_lamps_need(gconstpointer given, GPtrArray *to) {
    const struct usb_relays *relays = given;
    relays_need(relays, relays->n, to);
}

static void relays_laser_needs(gconstpointer given, GPtrArray *to) {
    relays_need(given, 1, to);
}

#define FIELD(name) G_STRUCT_OFFSET(struct usb_relays, name)

/* clang-format off */
#define BOARD_OPTIONS                                                                              \
    {"serial", OPTION_STRING, NULL, 0, 0, "", NULL, FIELD(serial),                                 \
     "The board's own serial number of five characters; may be left out if only one board is "     \
     "plugged in"},                                                                                \
    {"path", OPTION_STRING, NULL, 0, 0, "", NULL, FIELD(path),                                     \
     "USB path of the board: bus-port, and .port for each hub, as in 1-2.4"}
/* clang-format on */

static const struct option lamps_options[] = {
    BOARD_OPTIONS,
    {"first_relay", OPTION_INT, NULL, 1, MAX_RELAYS, "1", NULL, FIELD(first),
     "Relay of the first lamp; the others follow"},
    {"n_lamps", OPTION_INT, NULL, 0, MAX_RELAYS, "0", NULL, FIELD(n),
     "Number of lamps; 0: up to the board's last relay"},
    {"warm_up_ms", OPTION_DOUBLE, "ms", 0, 600000, "0", NULL, FIELD(warm_up_ms),
     "Time from switching on until a lamp's output is stable"},
    {NULL},
};

static void relays_on_lamp(gpointer device, int index, gboolean on, GError *error) {
    lamps_report(device, index, on, error);
}

static gboolean lamps_switch(LampBank *bank, int index, gboolean on, GError **error) {
    struct usb_relays *lamps = bank->device.priv;
    guint mask = index < 0 ? mask_of(lamps->first, bank->n) : mask_of(lamps->first + index, 1);
    if (board_switch(lamps->board, mask, on, relays_on_lamp, bank, index, error))
        return TRUE;
    error_details_add_subject(error, bank->device.who);
    return FALSE;
}

static gboolean lamps_may_shine(gpointer device) {
    const LampBank *bank = device;
    gboolean any = FALSE;
    for (int i = 0; i < bank->n; i++)
        any |= lamps_is_on(bank, i);
    return any;
}

static void relays_lost_lamps(gpointer device, GError *error) {
    lamps_lost(device, error);
}

static gboolean relays_open_lamps(LampBank *bank, GError **error) {
    struct usb_relays *lamps = bank->device.priv;
    lamps->device = bank;
    lamps->may_shine = lamps_may_shine;
    lamps->lost = relays_lost_lamps;
    bank->n = lamps->n;
    bank->warm_up_s = lamps->warm_up_ms / 1000;
    lamps->board = board_enter(&bank->device, lamps, &bank->n, error);
    return lamps->board != NULL;
}

static void relays_close_lamps(LampBank *bank) {
    struct usb_relays *lamps = bank->device.priv;
    board_leave(lamps, mask_of(lamps->first, bank->n));
}

const struct lamps_driver usb_relays_driver = {
    .info = {"lamps", "usb-relays", "Lamps on a USB relay board (16c0:05df, up to 8 relays)",
             lamps_options, sizeof(struct usb_relays), NULL, relays_lamps_need},
    .open = relays_open_lamps,
    .close = relays_close_lamps,
    .set = lamps_switch,
};

static const struct option laser_options[] = {
    BOARD_OPTIONS,
    {"relay", OPTION_INT, NULL, 1, MAX_RELAYS, NULL, NULL, FIELD(first), "The laser's relay"},
    {"warm_up_ms", OPTION_DOUBLE, "ms", 0, 600000, "0", NULL, FIELD(warm_up_ms),
     "Time from switching on until the laser's power is stable"},
    {NULL},
};

static void relays_on_laser(gpointer device, int index, gboolean on, GError *error) {
    laser_report(device, on, error);
}

static gboolean laser_switch(Laser *laser, gboolean on, GError **error) {
    struct usb_relays *priv = laser->device.priv;
    if (board_switch(priv->board, mask_of(priv->first, 1), on, relays_on_laser, laser, 0, error))
        return TRUE;
    error_details_add_subject(error, laser->device.who);
    return FALSE;
}

static gboolean laser_may_shine(gpointer device) {
    return laser_is_on(device);
}

static void relays_lost_laser(gpointer device, GError *error) {
    laser_lost(device, error);
}

static gboolean relays_open_laser(Laser *laser, GError **error) {
    struct usb_relays *priv = laser->device.priv;
    priv->device = laser;
    priv->may_shine = laser_may_shine;
    priv->lost = relays_lost_laser;
    priv->n = 1;
    laser->warm_up_s = priv->warm_up_ms / 1000;
    priv->board = board_enter(&laser->device, priv, &priv->n, error);
    return priv->board != NULL;
}

static void relays_close_laser(Laser *laser) {
    struct usb_relays *priv = laser->device.priv;
    board_leave(priv, mask_of(priv->first, 1));
}

const struct laser_driver usb_relay_laser_driver = {
    .info = {"laser", "usb-relay-laser", "A laser switched by a relay of a USB relay board",
             laser_options, sizeof(struct usb_relays), NULL, relays_laser_needs},
    .open = relays_open_laser,
    .close = relays_close_laser,
    .set = laser_switch,
};
