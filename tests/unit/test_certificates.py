"""Certificates: a CA, one a role, read back as a link would; bad ones are told with the remedy."""

import datetime
import shutil
from pathlib import Path

import pytest

from juncnet import links
from juncnet.access import Role
from juncnet.flight import Flight
from juncnet.identity import CA, CERTIFICATE, KEY, IdentityError, read_identity
from juncnet_services.cli.authority import EARLIER, open_authority
from juncnet_services.cli.certificates import main

FLIGHT = Flight("f", Path("/nowhere"), "robot", ("router", "command_output"))


@pytest.fixture(name="made", scope="module")
def _made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made") / "certificates"
    assert main([str(folder), "--host", "drone.local", "--host", "192.168.1.20"]) == 0
    return folder


@pytest.fixture(name="folder")
def _folder(made: Path, tmp_path: Path) -> Path:
    copy = tmp_path / "certificates"
    shutil.copytree(made, copy)
    return copy


@pytest.mark.parametrize("role", list(Role))
def test_each_role_has_a_certificate_of_a_year(made: Path, role: Role) -> None:
    identity = read_identity(made / role)
    assert identity.role is role
    left = identity.ends - datetime.datetime.now(datetime.UTC)
    assert datetime.timedelta(days=364) < left <= datetime.timedelta(days=365)
    assert identity.is_server is (role is Role.DRONE)


def test_the_vehicle_can_be_dialled_by_its_names(made: Path) -> None:
    hosts = read_identity(made / Role.DRONE).hosts
    assert hosts == ("drone.local", "192.168.1.20", "localhost", "127.0.0.1", "::1")
    assert read_identity(made / Role.VIEWER).hosts == ()


def test_only_the_owner_can_read_them(made: Path) -> None:
    for path in made.rglob("*"):
        assert path.stat().st_mode & 0o077 == 0, path
    (made / Role.VIEWER / KEY).chmod(0o640)
    with pytest.raises(IdentityError, match="chmod 600"):
        read_identity(made / Role.VIEWER)
    (made / Role.VIEWER / KEY).chmod(0o600)


def test_a_further_call_keeps_what_is_there(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = {path: path.read_bytes() for path in folder.rglob("*.pem")}
    (folder / Role.VIEWER / CERTIFICATE).unlink()
    assert main([str(folder)]) == 0
    changed = {path.parent.name for path, old in before.items() if path.read_bytes() != old}
    assert changed == {Role.VIEWER}
    assert "operator until 20" in capsys.readouterr().out
    assert main([str(folder), "--renew", "operator", "--host", "10.0.0.7"]) == 0
    assert before[folder / "operator" / KEY] != (folder / "operator" / KEY).read_bytes()
    assert {"10.0.0.7", "drone.local"} <= set(read_identity(folder / Role.DRONE).hosts)
    assert before[folder / "navigation" / KEY] == (folder / "navigation" / KEY).read_bytes()


def test_a_new_authority_shuts_out_what_was_before(folder: Path) -> None:
    lost = folder.parent / "lost"
    shutil.copytree(folder / Role.OPERATOR, lost)
    assert main([str(folder), "--new-authority"]) == 0
    shutil.copy(folder / Role.OPERATOR / CA, lost / CA)
    with pytest.raises(IdentityError, match="deploy/certificates"):
        read_identity(lost)


HOSTS = ("drone.local", "192.168.1.20", "localhost", "127.0.0.1", "::1")


def test_a_new_authority_keeps_the_vehicles_names(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(folder), "--new-authority", "--host", "10.0.0.7"]) == 0
    assert read_identity(folder / Role.DRONE).hosts == ("10.0.0.7", *HOSTS)
    told = capsys.readouterr().out
    assert "for 10.0.0.7, drone.local, 192.168.1.20, localhost" in told
    assert "WARNING" not in told


def test_an_expired_certificate_of_the_vehicle_is_made_anew_under_its_names(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr("juncnet_services.cli.authority.EARLIER", 3 * EARLIER)
        authority = open_authority(folder / "authority")
        authority.issue(folder / Role.DRONE, Role.DRONE, HOSTS[:2], -1)
    with pytest.raises(IdentityError, match="expired"):
        read_identity(folder / Role.DRONE)
    assert main([str(folder)]) == 0
    assert read_identity(folder / Role.DRONE).hosts == HOSTS


def test_a_vehicle_that_no_other_host_can_dial_is_warned_of(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / Role.DRONE / CERTIFICATE).write_text("not a certificate")
    assert main([str(folder)]) == 0
    assert "WARNING: no other host can dial the vehicle" in (told := capsys.readouterr().out)
    assert "--host NAME" in told
    assert main([str(folder), "--host", "drone.local"]) == 0
    assert "WARNING" not in capsys.readouterr().out


def test_what_is_wrong_is_named_with_the_remedy(folder: Path) -> None:
    viewer, operator = folder / Role.VIEWER, folder / Role.OPERATOR
    with pytest.raises(IdentityError, match=r"nowhere/ca\.pem.*deploy/certificates"):
        read_identity(folder / "nowhere")
    shutil.copy(operator / KEY, viewer / KEY)
    with pytest.raises(IdentityError, match=r"viewer.*deploy/certificates"):
        read_identity(viewer)
    (operator / CERTIFICATE).write_text("not a certificate")
    with pytest.raises(IdentityError, match="operator"):
        read_identity(operator)


def test_an_expired_certificate_says_so_and_is_made_anew(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    authority = open_authority(folder / "authority")
    monkeypatch.setattr("juncnet_services.cli.authority.EARLIER", 3 * EARLIER)
    authority.issue(folder / "viewer", Role.VIEWER, [], -1)
    with pytest.raises(IdentityError, match=r"expired.*deploy/certificates"):
        read_identity(folder / "viewer")
    assert main([str(folder)]) == 0
    assert read_identity(folder / "viewer").role is Role.VIEWER


@pytest.mark.parametrize(
    "arguments", [["--host", "a b"], ["--host", "-"], ["--days", "0", "--renew", "viewer"]]
)
def test_what_cannot_be_made_is_refused(
    folder: Path, arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(folder), *arguments]) == 2
    assert arguments[0] in capsys.readouterr().err
    assert read_identity(folder / Role.DRONE).role is Role.DRONE


def test_a_router_lets_in_with_the_vehicles_certificate_only(made: Path) -> None:
    drone, viewer = (read_identity(made / role) for role in (Role.DRONE, Role.VIEWER))
    settings = links.gateway(FLIGHT, "tls/0.0.0.0:7447", drone)
    assert settings["access_control"]["default_permission"] == "deny"
    assert settings["transport"]["link"]["tls"]["enable_mtls"] is True
    with pytest.raises(ValueError, match="use drone"):
        links.gateway(FLIGHT, "tls/0.0.0.0:7447", viewer)
    with pytest.raises(ValueError, match="dials nobody"):
        links.outsider("tls/drone.local:7447", drone)
    dialled = links.outsider("tls/drone.local:7447", viewer)["transport"]["link"]["tls"]
    assert dialled["verify_name_on_connect"] is True
    assert dialled["connect_certificate"] == str(made / "viewer" / CERTIFICATE)


def test_without_certificates_there_is_no_access_control() -> None:
    assert "access_control" not in links.gateway(FLIGHT, "tcp/127.0.0.1:7447")
    assert links.endpoint("127.0.0.1:7447") == "tcp/127.0.0.1:7447"


@pytest.mark.parametrize("host", ["127.0.0.1", "127.9.9.9", "::1", "localhost"])
def test_loopback_is_known(host: str) -> None:
    assert links.is_loopback(host)


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.1.2", "drone.local", ""])
def test_anything_else_is_not_loopback(host: str) -> None:
    assert not links.is_loopback(host)
