"""Seabreeze's own USB transport and parsers against `sim-ocean`: pyusb is given a backend that carries bulk transfers over a socket in place of a bus.

    python ocean_usb.py HOST PORT

The backend is pyusb's `IBackend` of one HDX (2457:2003), endpoints 0x01 and 0x81 of 512 bytes. A transfer to the instrument is what is sent; one from it ends with the bytes that seabreeze
asked for, as on a bus where the instrument has no more to say. Prints model and serial number, the wavelengths, two spectra of 20 ms and two of 60 ms, and the lengths of the reads.
"""

import array
import socket
import sys
from types import SimpleNamespace

import seabreeze

seabreeze.use("pyseabreeze")
import usb.backend
import usb.core
from seabreeze.pyseabreeze import devices, transport


class Bus(usb.backend.IBackend):
    """One instrument on a bus that is a socket."""

    def __init__(self, address):
        self.socket = socket.create_connection(address, timeout=20)
        self.reads = set()

    def enumerate_devices(self):
        yield "hdx"

    def get_device_descriptor(self, device):
        return SimpleNamespace(
            bLength=18, bDescriptorType=1, bcdUSB=0x200, bDeviceClass=255, bDeviceSubClass=0, bDeviceProtocol=0, bMaxPacketSize0=64, idVendor=0x2457,
            idProduct=0x2003, bcdDevice=0, iManufacturer=0, iProduct=0, iSerialNumber=0, bNumConfigurations=1, address=1, bus=1, port_number=1,
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
            bLength=9, bDescriptorType=4, bInterfaceNumber=0, bAlternateSetting=0, bNumEndpoints=2, bInterfaceClass=255, bInterfaceSubClass=0,
            bInterfaceProtocol=0, iInterface=0, extra_descriptors=[])

    def get_endpoint_descriptor(self, device, endpoint, interface, alternate, configuration):
        return SimpleNamespace(
            bLength=7, bDescriptorType=5, bEndpointAddress=[0x01, 0x81][endpoint], bmAttributes=2, wMaxPacketSize=512, bInterval=0, bRefresh=0,
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
        assert endpoint == 0x01, endpoint
        self.socket.sendall(bytes(data))
        return len(data)

    def bulk_read(self, handle, endpoint, interface, buffer, timeout):
        assert endpoint == 0x81, endpoint
        self.reads.add(len(buffer))
        data = self.socket.recv(len(buffer), socket.MSG_WAITALL)
        buffer[: len(data)] = array.array("B", data)
        return len(data)


bus = Bus((sys.argv[1], int(sys.argv[2])))
device = devices.SeaBreezeDevice(transport.USBTransportHandle(usb.core.find(backend=bus)))
device.open()
print(device.model, device.serial_number)
spectrometer = device.f.spectrometer
print(*spectrometer.get_wavelengths())
for micros in 20000, 60000:
    spectrometer.set_integration_time_micros(micros)
    for _ in range(2):
        print(*spectrometer.get_intensities())
print(*sorted(bus.reads))
