#include "gige_private.h"

#define NAMESPACE "http://www.genicam.org/GenApi/Version_1_1"

static const char *const features[] = {"DeviceVendorName",
                                       "DeviceModelName",
                                       "DeviceSerialNumber",
                                       "DeviceID",
                                       "SensorWidth",
                                       "SensorHeight",
                                       "Width",
                                       "Height",
                                       "OffsetX",
                                       "OffsetY",
                                       "PixelFormat",
                                       "PayloadSize",
                                       "AcquisitionMode",
                                       "AcquisitionStart",
                                       "AcquisitionStop",
                                       "TriggerSelector",
                                       "TriggerMode",
                                       "TriggerSource",
                                       "TriggerActivation",
                                       "TriggerSoftware",
                                       "ExposureTime",
                                       "ExposureAuto",
                                       "Gain",
                                       "BlackLevel",
                                       "GevSCPSPacketSize",
                                       "GevSCPD",
                                       "GevSCPSFireTestPacket"};

static void add_register(GString *xml, const char *name, guint address, const char *access) {
    g_string_append_printf(xml,
                           "<IntReg Name=\"%sReg\"><Address>0x%x</Address><Length>4</Length>"
                           "<AccessMode>%s</AccessMode><pPort>Device</pPort>"
                           "<Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg>\n",
                           name, address, access);
}

/* limits: elements, as <Min> and <pMax>. */
static void add_integer(GString *xml, const char *name, guint address, const char *access,
                        const char *limits) {
    g_string_append_printf(xml, "<Integer Name=\"%s\"><pValue>%sReg</pValue>%s</Integer>\n", name,
                           name, limits);
    add_register(xml, name, address, access);
}

static void add_string(GString *xml, const char *name, guint address, int length) {
    g_string_append_printf(xml,
                           "<StringReg Name=\"%s\"><Address>0x%x</Address><Length>%d</Length>"
                           "<AccessMode>RO</AccessMode><pPort>Device</pPort></StringReg>\n",
                           name, address, length);
}

static void add_command(GString *xml, const char *name, const char *reg, int value) {
    g_string_append_printf(xml,
                           "<Command Name=\"%s\"><pValue>%sReg</pValue>"
                           "<CommandValue>%d</CommandValue></Command>\n",
                           name, reg, value);
}

/* A register that counts parts of a unit. */
static void add_float(GString *xml, const char *name, guint address, const char *unit, double parts,
                      double max) {
    g_string_append_printf(xml,
                           "<Float Name=\"%s\"><pValue>%sConverter</pValue><Min>0</Min>"
                           "<Max>%g</Max><Unit>%s</Unit></Float>\n"
                           "<Converter Name=\"%sConverter\"><FormulaTo>FROM*%g</FormulaTo>"
                           "<FormulaFrom>TO/%g</FormulaFrom><pValue>%sReg</pValue></Converter>\n",
                           name, name, max, unit, name, parts, parts, name);
    add_register(xml, name, address, "RW");
}

/* entries: names in the order of their values, NULL-terminated. */
static void add_choice(GString *xml, const char *name, guint address, const char *const *entries) {
    g_string_append_printf(xml, "<Enumeration Name=\"%s\">\n", name);
    for (int i = 0; entries[i]; i++)
        g_string_append_printf(xml, "<EnumEntry Name=\"%s\"><Value>%d</Value></EnumEntry>\n",
                               entries[i], i);
    if (address == 0) {
        g_string_append(xml, "<Value>0</Value></Enumeration>\n");
        return;
    }
    g_string_append_printf(xml, "<pValue>%sReg</pValue></Enumeration>\n", name);
    add_register(xml, name, address, "RW");
}

static void add_device(GString *xml) {
    add_string(xml, "DeviceVendorName", GVBS_VENDOR, 32);
    add_string(xml, "DeviceModelName", GVBS_MODEL, 32);
    add_string(xml, "DeviceSerialNumber", GVBS_SERIAL, 16);
    add_string(xml, "DeviceID", GVBS_SERIAL, 16);
}

static void add_image(GString *xml, enum cfa cfa) {
    add_integer(xml, "SensorWidth", REG_SENSOR_WIDTH, "RO", "");
    add_integer(xml, "SensorHeight", REG_SENSOR_HEIGHT, "RO", "");
    add_integer(xml, "Width", REG_WIDTH, "RW", "<Min>2</Min><pMax>SensorWidth</pMax><Inc>2</Inc>");
    add_integer(xml, "Height", REG_HEIGHT, "RW",
                "<Min>2</Min><pMax>SensorHeight</pMax><Inc>2</Inc>");
    add_integer(xml, "OffsetX", REG_OFFSET_X, "RW",
                "<Min>0</Min><pMax>SensorWidth</pMax><Inc>2</Inc>");
    add_integer(xml, "OffsetY", REG_OFFSET_Y, "RW",
                "<Min>0</Min><pMax>SensorHeight</pMax><Inc>2</Inc>");
    add_integer(xml, "PayloadSize", REG_PAYLOAD, "RO", "");
    g_string_append(xml, "<Enumeration Name=\"PixelFormat\">\n");
    virtual_gige_append_formats(xml, cfa);
    g_string_append(xml, "<pValue>PixelFormatReg</pValue></Enumeration>\n");
    add_register(xml, "PixelFormat", REG_FORMAT, "RW");
}

static void add_acquisition(GString *xml) {
    static const char *const modes[] = {"Continuous", NULL}, *const selectors[] = {"FrameStart",
                                                                                   NULL};
    static const char *const off_on[] = {"Off", "On", NULL};
    static const char *const sources[] = {"Line0", "Software", NULL};
    static const char *const edges[] = {"RisingEdge", NULL};
    static const char *const automatic[] = {"Off", "Continuous", NULL};
    g_autofree char *exposures =
        g_strdup_printf("<Min>%d</Min><Max>%d</Max>", MIN_EXPOSURE_US, MAX_EXPOSURE_US);
    add_choice(xml, "AcquisitionMode", 0, modes);
    add_choice(xml, "TriggerSelector", 0, selectors);
    add_choice(xml, "TriggerMode", REG_TRIGGER_MODE, off_on);
    add_choice(xml, "TriggerSource", REG_TRIGGER_FROM, sources);
    add_choice(xml, "TriggerActivation", 0, edges);
    add_choice(xml, "ExposureAuto", REG_AUTO_EXPOSURE, automatic);
    add_command(xml, "AcquisitionStart", "Acquisition", 1);
    add_command(xml, "AcquisitionStop", "Acquisition", 0);
    add_register(xml, "Acquisition", REG_ACQUISITION, "WO");
    add_command(xml, "TriggerSoftware", "Trigger", 1);
    add_register(xml, "Trigger", REG_TRIGGER, "WO");
    g_string_append_printf(xml,
                           "<Float Name=\"ExposureTime\"><pValue>ExposureTimeReg</pValue>%s"
                           "<Unit>us</Unit></Float>\n",
                           exposures);
    add_register(xml, "ExposureTime", REG_EXPOSURE_US, "RW");
    add_float(xml, "Gain", REG_GAIN, "dB", 100, MAX_GAIN / 100.0);
    add_float(xml, "BlackLevel", REG_BLACK, "DN", 10, 4095);
}

static void add_transport(GString *xml) {
    g_autofree char *sizes = g_strdup_printf("<Min>576</Min><Max>%d</Max><Inc>4</Inc>", MAX_PACKET);
    g_string_append_printf(xml,
                           "<Integer Name=\"GevSCPSPacketSize\"><pValue>PacketSizeReg</pValue>%s"
                           "</Integer>\n<MaskedIntReg Name=\"PacketSizeReg\">"
                           "<Address>0x%x</Address><Length>4</Length><AccessMode>RW</AccessMode>"
                           "<pPort>Device</pPort><LSB>31</LSB><MSB>16</MSB><Sign>Unsigned</Sign>"
                           "<Endianess>BigEndian</Endianess></MaskedIntReg>\n"
                           "<MaskedIntReg Name=\"FireReg\">"
                           "<Address>0x%x</Address><Length>4</Length><AccessMode>RW</AccessMode>"
                           "<pPort>Device</pPort><Bit>0</Bit><Sign>Unsigned</Sign>"
                           "<Endianess>BigEndian</Endianess></MaskedIntReg>\n",
                           sizes, GVBS_PACKET_SIZE, GVBS_PACKET_SIZE);
    add_command(xml, "GevSCPSFireTestPacket", "Fire", 1);
    add_integer(xml, "GevSCPD", GVBS_PACKET_DELAY, "RW", "<Min>0</Min><Max>1000000000</Max>");
}

char *virtual_gige_genicam(enum cfa cfa) {
    GString *xml = g_string_new("<?xml version=\"1.0\" encoding=\"utf-8\"?>\n");
    g_string_append(xml, "<RegisterDescription ModelName=\"VirtualCamera\" VendorName=\"Mesorig\" "
                         "StandardNameSpace=\"GEV\" SchemaMajorVersion=\"1\" "
                         "SchemaMinorVersion=\"1\" SchemaSubMinorVersion=\"0\" MajorVersion=\"1\" "
                         "MinorVersion=\"0\" SubMinorVersion=\"0\" ToolTip=\"Virtual camera\" "
                         "ProductGuid=\"0\" VersionGuid=\"0\" xmlns=\"" NAMESPACE "\">\n"
                         "<Category Name=\"Root\">\n");
    for (gsize i = 0; i < G_N_ELEMENTS(features); i++)
        g_string_append_printf(xml, "<pFeature>%s</pFeature>\n", features[i]);
    g_string_append(xml, "</Category>\n");
    add_device(xml);
    add_image(xml, cfa);
    add_acquisition(xml);
    add_transport(xml);
    g_string_append(xml, "<Port Name=\"Device\"></Port>\n</RegisterDescription>\n");
    return g_string_free(xml, FALSE);
}
