"""Seabreeze's own USB transport and parsers of the older protocol (OOI) against our simulated spectrometers: pyusb is given a backend that carries bulk transfers over pipes in place of a bus.

    python ocean_ooi.py            prints seabreeze's table of the models that speak it
    python ocean_ooi.py PRODUCT SPEED [PRODUCT SPEED ...]   drives them, one after the other

The backend is pyusb's `IBackend` of one instrument. What it wants of the instrument it writes as lines: `model PRODUCT SPEED`, `out ENDPOINT HEX`, `in ENDPOINT LENGTH TIMEOUT_MS`; the answer is `ok HEX`, `timeout`
or `error`. What seabreeze made of it are lines that begin with `said`.
"""

import array
import sys
from types import SimpleNamespace

import seabreeze

seabreeze.use("pyseabreeze")
import usb.backend
import usb.core
from seabreeze.pyseabreeze import devices, protocol, transport
from seabreeze.pyseabreeze.features.fpga import _FPGARegisterFeatureOOI
from seabreeze.spectrometers import Spectrometer


def keywords(specialised):
    """Keywords with which seabreeze has made a class of its own for a model."""
    return vars(specialised)["__init__"].keywords


def models():
    """Product number, endpoints and properties of each model that speaks OOI."""
    for name, cls in devices._model_class_registry.items():
        if name == "FLAMES":
            continue
        about = keywords(cls._transport_classes[-1]) if cls._transport_classes else {}
        if about.get("usb_protocol") is protocol.OOIProtocol:
            yield name, about, keywords(cls._feature_classes["spectrometer"][0])


def flat(dark):
    """Dark pixels; some models have them in a tuple too many."""
    return [pixel for entry in dark for pixel in (entry if isinstance(entry, tuple) else (entry,))]


def ask(*words):
    print(*words, flush=True)
    kind, _, data = sys.stdin.readline().strip().partition(" ")
    if kind == "timeout":
        raise usb.core.USBTimeoutError("timeout", errno=110)
    if kind != "ok":
        raise usb.core.USBError(kind, errno=5)
    return bytes.fromhex(data)


class Bus(usb.backend.IBackend):
    """One instrument on a bus that is a pair of pipes."""

    def __init__(self, product, endpoints, packet):
        self.product, self.endpoints, self.packet = product, endpoints, packet

    def enumerate_devices(self):
        yield "spectrometer"

    def get_device_descriptor(self, device):
        return SimpleNamespace(
            bLength=18, bDescriptorType=1, bcdUSB=0x200, bDeviceClass=255, bDeviceSubClass=0, bDeviceProtocol=0, bMaxPacketSize0=64, idVendor=0x2457,
            idProduct=self.product, bcdDevice=0, iManufacturer=0, iProduct=0, iSerialNumber=0, bNumConfigurations=1, address=1, bus=1, port_number=1,
            port_numbers=(1,), speed=3)

    def get_configuration_descriptor(self, device, configuration):
        if configuration:
            raise IndexError
        return SimpleNamespace(
            bLength=9, bDescriptorType=2, wTotalLength=32, bNumInterfaces=1, bConfigurationValue=1, iConfiguration=0, bmAttributes=0x80, bMaxPower=250,
            extra_descriptors=[])

    def get_interface_descriptor(self, device, interface, alternate, configuration):
        if interface or alternate or configuration:
            raise IndexError
        return SimpleNamespace(
            bLength=9, bDescriptorType=4, bInterfaceNumber=0, bAlternateSetting=0, bNumEndpoints=len(self.endpoints), bInterfaceClass=255,
            bInterfaceSubClass=0, bInterfaceProtocol=0, iInterface=0, extra_descriptors=[])

    def get_endpoint_descriptor(self, device, endpoint, interface, alternate, configuration):
        return SimpleNamespace(
            bLength=7, bDescriptorType=5, bEndpointAddress=self.endpoints[endpoint], bmAttributes=2, wMaxPacketSize=self.packet, bInterval=0, bRefresh=0,
            bSynchAddress=0, extra_descriptors=[])

    def open_device(self, device):
        return 1

    def close_device(self, handle):
        pass

    def set_configuration(self, handle, value):
        pass

    def get_configuration(self, handle):
        return 1

    def claim_interface(self, handle, interface):
        pass

    def release_interface(self, handle, interface):
        pass

    def reset_device(self, handle):
        pass

    def bulk_write(self, handle, endpoint, interface, data, timeout):
        ask("out", endpoint, bytes(data).hex())
        return len(data)

    def bulk_read(self, handle, endpoint, interface, buffer, timeout):
        data = ask("in", endpoint, len(buffer), timeout)
        buffer[: len(data)] = array.array("B", data)
        return len(data)


def table():
    for name, about, has in models():
        ends = about["usb_endpoint_map"]
        numbers = [
            about["usb_vendor_id"], about["usb_product_id"], ends.ep_out, ends.lowspeed_in, ends.highspeed_in, ends.highspeed_in2 or 0,
            has["integration_time_min"], has["integration_time_max"], has["integration_time_base"], has["spectrum_num_pixel"],
            has["spectrum_raw_length"], has["spectrum_max_value"], *flat(has["dark_pixel_indices"])]
        print(name, *numbers)


def drive(product, speed):
    about = next(about for _, about, _ in models() if about["usb_product_id"] == product)
    ends = about["usb_endpoint_map"]
    endpoints = [ends.ep_out, ends.lowspeed_in, ends.highspeed_in, *([ends.highspeed_in2] if ends.highspeed_in2 else [])]
    ask("model", product, speed)
    bus = Bus(product, endpoints, 512 if speed == "high" else 64)
    device = devices.SeaBreezeDevice(transport.USBTransportHandle(usb.core.find(backend=bus)))
    device.open()
    print("said", device.model, device.serial_number)
    spectrometer = device.f.spectrometer
    print("said", *spectrometer.get_wavelengths())
    for micros in 20000, 60000:
        spectrometer.set_integration_time_micros(micros)
        for _ in range(2):
            print("said", *spectrometer.get_intensities())
    print("said", spectrometer.get_maximum_intensity())
    if device.f.nonlinearity_coefficients is not None:
        print("said", *_FPGARegisterFeatureOOI(device._transport.protocol).get_firmware_version())
        print("said", *device.f.nonlinearity_coefficients.get_nonlinearity_coefficients())
        print("said", *Spectrometer(device).intensities(correct_dark_counts=True, correct_nonlinearity=True))
    print("said end", flush=True)


if len(sys.argv) == 1:
    table()
for place in range(1, len(sys.argv), 2):
    drive(int(sys.argv[place]), sys.argv[place + 1])
