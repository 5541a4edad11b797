"""Certificates for the tests, made by the openssl program: an authority and those that it signs."""

import subprocess
from pathlib import Path

from tests.support.places import HANG_S


def openssl(*arguments: str | Path) -> None:
    subprocess.run(["openssl", *map(str, arguments)], check=True, capture_output=True, timeout=HANG_S)


class Authority:
    """A folder with ca.pem and, once issued, NAME.pem and NAME.key (mode 0600)."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir()
        self.folder = folder
        self.ca = folder / "ca.pem"
        self._request("ca", "-x509", "-days", "2", "-out", self.ca)

    def issue(self, name: str, host: str = "localhost") -> tuple[str, str]:
        """Certificate and key of somebody at `host`."""
        certificate, request, names = (self.folder / f"{name}{end}" for end in (".pem", ".csr", ".ext"))
        names.write_text(f"subjectAltName=DNS:{host}\nbasicConstraints=CA:FALSE\n")
        self._request(name, "-out", request)
        signer = ("-CA", self.ca, "-CAkey", self.folder / "ca.key", "-CAcreateserial")
        openssl("x509", "-req", "-in", request, *signer, "-days", "2", "-extfile", names, "-out", certificate)
        return str(certificate), str(self.folder / f"{name}.key")

    def _request(self, name: str, *options: str | Path) -> None:
        key = self.folder / f"{name}.key"
        kind = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes")
        openssl("req", *kind, "-subj", f"/CN={name}", "-keyout", key, *options)
        key.chmod(0o600)
